"""Action drivers: the port to a vehicle, the Replay driver, and both sides of the HTTP between them."""
