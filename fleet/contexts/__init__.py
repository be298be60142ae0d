"""Contexts: completely explored places that agents learn from and fly over."""
