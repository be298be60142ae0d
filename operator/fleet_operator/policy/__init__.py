"""What the platform decides about a fleet: pure functions, one policy a module."""
