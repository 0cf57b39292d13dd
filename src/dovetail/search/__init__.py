"""Searches for a fixture that is not seen: programs that act as a policy does."""
