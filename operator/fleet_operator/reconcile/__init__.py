"""What the operator does with one fleet at each pass; see `reconciler`."""

from fleet_operator.reconcile.reconciler import FleetReconciler

__all__ = ["FleetReconciler"]
