"""How fast missions can be simulated whose agents have belief features in the SSV; figures are in `bench.simulator`.

Agents that look one step ahead scout much worse than `fleet.planning`; so this is no part of the platform.
"""
