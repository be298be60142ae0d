"""Crash safety: the operator is killed after each of its writes, and the results compared with an undisturbed run."""
