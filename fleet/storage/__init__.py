"""Objects of a fleet: a port, and the backends behind it."""
