"""Searches for a fixture that nobody sees: programs that act as a policy does."""
