"""What a learning swarm is held against: plans of a sensible pilot, of the literature, and of one who knows all."""
