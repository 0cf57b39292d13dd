"""Peg in hole, the paper's task."""
