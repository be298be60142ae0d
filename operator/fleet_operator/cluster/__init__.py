"""The only door to the Kubernetes API: credentials, transport, memory of the watches; the rest uses the port."""
