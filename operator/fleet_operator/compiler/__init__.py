"""From a validated FleetSpec and decisions to Kubernetes manifests; pure."""
