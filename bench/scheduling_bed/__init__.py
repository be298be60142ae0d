"""A cluster that is too small for all aggregators of a fleet at once, and how long each waits and lives in it."""
