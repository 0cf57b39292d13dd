"""A delay that the error in free motion hardly shows, and that a policy trips over."""

import math
from dataclasses import replace

from dovetail.identify.replay import LogReplay
from dovetail.plants.plant import DynamicsConfig, physics_steps
from dovetail.plants.twin import Twin

LONGEST = 0.03
"""Longest delay that is tried [s], the bound of the parameter `command_delay`."""


def hidden_delay(replay: LogReplay, model: Twin) -> float:
    """Return by how much later than the model the arm obeys [s].

    It is the one of all whole physics steps, to a delay of 0 to `LONGEST` in all, with
    which the model meets the log best; everything else stays as it is. Delays
    that matter (20 ms) stand out where little else is left; a short one can hide behind
    friction that was not fitted. A whole grid, because the effect is not monotone.

    Args:
        replay: The log.
        model: The model to try; its own delay is between 0 and `LONGEST`.
    """
    period = replay.recording.period
    step = period / physics_steps(period, DynamicsConfig().physics_dt)
    own = model.command_delay
    first, last = -math.floor(own / step + 1e-9), math.floor((LONGEST - own) / step)
    later = [step * i for i in range(first, last + 1)]
    errors = [
        replay.rms(replace(model, command_delay=max(0.0, own + t))) for t in later
    ]
    return later[errors.index(min(errors))]
