"""Names, labels and roles of everything in the cluster."""
