"""Missions over contexts, fast: many at once, exact to the plain form."""
