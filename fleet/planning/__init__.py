"""Where to look next: agents that plan over what the swarm believes of the field, and know when it is enough."""
