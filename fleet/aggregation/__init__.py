"""Which subsets of the agents retrain a model each, and how."""
