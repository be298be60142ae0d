"""The Fleet Computer's library: from a FleetSpec, Map() and Eval() to trained models and flown missions."""

__version__ = "0.1.0"
