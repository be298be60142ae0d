"""A real Kubernetes on one computer, for tests and for `make cluster`: machines, network, control plane, power."""
