"""Peg in hole, the paper's task, and the usual one."""

USUAL_POLICY = "peg_near"
"""The shipped policy that is tried where none is asked for."""
TRUSTING_POLICY = "peg_square"
"""The shipped policy that takes the hole's pose for true."""
