"""What `fleet run` and the operator do alike with a fleet's storage and files: orders, landings, sources, progress."""
