"""A delay that the error in free motion hardly shows, and that a policy trips over."""

from dataclasses import replace

from dovetail.identify.replay import Replay
from dovetail.plants.plant import DynamicsConfig, physics_steps
from dovetail.plants.twin import TwinConfig

LONGEST = 0.03
"""Longest delay that is tried [s], the bound of the parameter `command_delay`."""


def hidden_delay(replay: Replay, model: TwinConfig) -> float:
    """Return by how much later than the model the arm obeys [s].

    It is the delay, of all whole physics steps up to `LONGEST`, with which the model
    meets the log best, minus the model's own; everything else stays as it is. Delays
    that matter (20 ms) stand out where little else is left; a short one can hide behind
    friction that was not fitted. A whole grid, because the effect is not monotone.

    Args:
        replay: The log.
        model: The model to try; its own delay is between 0 and `LONGEST`.
    """
    period = replay.recording.period
    step = period / physics_steps(period, DynamicsConfig().physics_dt)
    count = round(LONGEST / step)
    tried = [step * i for i in range(count + 1)]
    errors = [replay.rms(replace(model, command_delay=delay)) for delay in tried]
    best = tried[errors.index(min(errors))]
    return best - step * round(model.command_delay / step)
