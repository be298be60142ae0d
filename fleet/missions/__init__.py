"""A mission: who flies where, one agent's flight, its records, and the documents that roles leave for each other."""
