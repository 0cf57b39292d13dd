"""Gymnasium environments: one policy step is 50 ms of the arm's time."""
