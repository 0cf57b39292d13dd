"""One try as it is planned."""

from typing import NamedTuple


class TrialJob(NamedTuple):
    """One try to run."""

    pose: int
    """Index of the fixture pose."""
    attempt: int
    """Number of the try at this pose, from 0."""
    seed: int
    """Seed of the environment's reset: start pose and noise."""
