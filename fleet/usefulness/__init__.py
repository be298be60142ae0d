"""How much each agent trusts each model, and how useful the models are."""
