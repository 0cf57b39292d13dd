"""Learn from demonstrations before the first action.

They are in the replay buffer, so that these are gradient steps as any later ones. Layer
normalisation keeps the critics from inventing values in states that no demonstration
has. The entropy coefficient waits: it weighs chance against values that no action of
the policy's own has tried yet, and would rise, to fall for thousands of steps.

Reference:
    Ball et al. 2023, Efficient online reinforcement learning with offline data,
    section 4.2: layer normalisation bounds what a critic extrapolates.
"""

import math
from collections.abc import Callable
from typing import Any

from dovetail.learn.config import TrainConfig
from dovetail.learn.sbx_model import ENTROPY, put_states, trained_states


def pretrain(
    model: Any, config: TrainConfig, check: Callable[[], None] = lambda: None
) -> None:
    """Do the run's gradient steps that come before its first action.

    Args:
        model: SBX algorithm with the demonstrations in its buffer, and a logger.
        config: Settings of the run; `pretrain` says how many, rounded up to whole
            rounds of `gradient_steps`.
        check: Called before every round; raises KeyboardInterrupt to end it.
    """
    states = trained_states(model)
    waiting = {name: states[name] for name in states if name == ENTROPY}
    for _ in range(math.ceil(config.first_updates / config.gradient_steps)):
        check()
        model.train(config.gradient_steps, config.batch_size)
        put_states(model, trained_states(model) | waiting)
