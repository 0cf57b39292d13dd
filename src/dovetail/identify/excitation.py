"""The scripted actions that are played on an arm to identify it."""

import numpy as np

from dovetail.errors import ConfigError
from dovetail.types import Array

AXES = 4
"""Commanded axes of the task XYZ:force A:pose BC:hold."""
POLICY_PERIOD = 0.05
"""Time between two actions [s]."""
FREQUENCIES = (0.4, 0.8, 1.2, 1.6, 2.4, 3.2)
"""Frequencies of the excitation [Hz]: whole periods in 50 steps, so that it ends where
it began, and at most a third of the policy's Nyquist frequency of 10 Hz."""

EXCITATION = (
    "each of X Y Z A: a sum of six sines, 0.4 to 3.2 Hz, whole periods in 2.5 s, with "
    "amplitudes falling as 1/f and phases drawn per sequence and axis, scaled so that "
    "its largest action is 1"
)


def excitation(seed: int, sequences: int = 10, steps: int = 50) -> Array:
    """Return scripted actions in [-1, 1].

    Args:
        seed: Seed of the phases, >= 0.
        sequences: Number of sequences.
        steps: Policy steps of each.

    Returns:
        Shape (sequences, steps, 4); axes X Y Z A.

    Raises:
        ConfigError: A count below 1, or a seed below 0.
    """
    for name, value, low in (("seed", seed, 0), ("sequences", sequences, 1)):
        if value < low:
            raise ConfigError(f"excitation {name} is {value}; allowed: {low} or more")
    if steps < 2:
        raise ConfigError(f"excitation steps is {steps}; allowed: 2 or more")
    rng = np.random.default_rng(seed)
    frequency = np.asarray(FREQUENCIES)
    phase = rng.uniform(0.0, 2.0 * np.pi, (sequences, 1, AXES, len(frequency)))
    time = POLICY_PERIOD * np.arange(steps)[None, :, None, None]
    waves = np.sin(2.0 * np.pi * frequency * time + phase) / frequency
    actions = waves.sum(axis=-1)
    return actions / np.abs(actions).max(axis=1, keepdims=True)
