"""Guided policy search by mirror descent: local controllers teach the network."""
