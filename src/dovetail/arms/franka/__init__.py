"""A Franka arm over its own protocol, FCI, by libfranka."""
