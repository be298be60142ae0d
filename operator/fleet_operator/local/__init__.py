"""Runs compiled manifests as processes of this machine."""
