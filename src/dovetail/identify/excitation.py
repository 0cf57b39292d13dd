"""The scripted actions that are played on an arm to identify it."""

import numpy as np

from dovetail.control.period import POLICY_PERIOD
from dovetail.settings import in_count
from dovetail.types import Array

EXCITED = "XYZ:force A:pose BC:hold"
"""Mode of each axis in every task: an arm is identified, not a task."""
AXES = 4
"""Commanded axes of it."""
FREQUENCIES = (0.8, 1.2, 1.6, 2.4, 3.2)
"""Frequencies of the excitation [Hz]: whole periods in 50 steps, so that the tool
stays near its start, and at most a third of the policy's Nyquist frequency, 10 Hz."""
SEQUENCES_MAX, STEPS_MAX = 1_000, 10_000
"""More than a robot plays: all actions are drawn before the first motion."""
DRAWS = 60
"""Sets of phases among which the one with the largest RMS action is kept: mass tells
itself from gravity by inertia alone, that is by fast changes of a large speed."""

EXCITATION = (
    "each of X Y Z A: a sum of five sines, 0.8 to 3.2 Hz, whole periods in 2.5 s, "
    "amplitudes falling as 1/f, largest action 1; phases per sequence and axis: of 60 "
    "random sets the one with the largest RMS"
)


def excitation(seed: int, sequences: int = 10, steps: int = 50) -> Array:
    """Return scripted actions in [-1, 1].

    Args:
        seed: Seed of the phases, >= 0.
        sequences: Number of sequences.
        steps: Policy steps of each.

    Returns:
        Shape (sequences, steps, 4); axes X Y Z A. With more sequences the first ones
        stay the same.

    Raises:
        ConfigError: One of the three is out of range.
    """
    in_count("excitation seed", seed, 0, 2**63 - 1, "(2^63 - 1)")
    in_count("excitation sequences", sequences, 1, SEQUENCES_MAX, "sequences")
    in_count("excitation steps", steps, 2, STEPS_MAX, "steps of 50 ms")
    return np.stack([_sequence(seed, number, steps) for number in range(sequences)])


def _sequence(seed: int, number: int, steps: int) -> Array:
    """Return the actions of one sequence, shape (steps, 4)."""
    rng = np.random.default_rng([seed, number])
    frequency = np.asarray(FREQUENCIES)
    phase = rng.uniform(0.0, 2.0 * np.pi, (DRAWS, 1, AXES, len(frequency)))
    time = POLICY_PERIOD * np.arange(steps)[:, None, None]
    waves = np.sin(2.0 * np.pi * frequency * time + phase) / frequency
    actions = waves.sum(axis=-1)  # (DRAWS, steps, AXES)
    actions /= np.abs(actions).max(axis=1, keepdims=True)
    best = (actions**2).mean(axis=1).argmax(axis=0)  # (AXES,)
    return actions[best, :, np.arange(AXES)].T
