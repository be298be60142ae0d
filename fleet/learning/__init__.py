"""State-to-action and history-to-action models, reward shaping, training."""
