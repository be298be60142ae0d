"""The platform around the library: compiled objects, policies, and the local runner."""
