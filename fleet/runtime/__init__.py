"""The programs: one module a role, started by `python -m fleet.runtime ROLE`."""
