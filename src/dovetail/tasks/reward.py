"""Rewards: plain functions of plain numbers."""

import math
from dataclasses import dataclass

from dovetail.types import Vec3


@dataclass(frozen=True, kw_only=True)
class RewardConfig:
    """Weights of the reward (Kaspar et al. 2020)."""

    alpha: float = 0.6
    """Weight of the Euclidean distance to the target [1/m]."""
    beta: float = 0.4
    """Weight of the Manhattan distance to the target [1/m]."""
    gamma: float = 0.1
    """Weight of the rotation error about the vertical [1/rad]."""
    bonus: float = 50.0
    """Reward added once, on success."""
    force_weight: float = 0.0
    """Weight of contact force above `force_free` [1/N]; 0 is the paper's reward."""
    force_free: float = 10.0
    """Contact force that costs nothing [N]."""


def distance_reward(
    position_error: Vec3,
    theta_error: float,
    success: bool,
    config: RewardConfig,
    force: float = 0.0,
) -> float:
    r"""Weigh how far the tool is from its target, plus a bonus on success.

    .. math:: r = -(\alpha |x|_2 + \beta |x|_1 + \gamma |\theta|) + 50\,[success]

    Args:
        position_error: Tool minus target [m], shape (3,).
        theta_error: Tool's rotation about the vertical minus the target's [rad].
        success: Whether the task is done in this step.
        config: Weights and bonus.
        force: Largest contact force of the step [N]; counts only with `force_weight`.

    Returns:
        Reward of one policy step, dimensionless.

    Reference:
        Kaspar, Munoz Osorio, Bock 2020, section IV.
    """
    x, y, z = position_error.tolist()
    distance = math.sqrt(x * x + y * y + z * z)
    manhattan = abs(x) + abs(y) + abs(z)
    cost = (
        config.alpha * distance
        + config.beta * manhattan
        + config.gamma * abs(theta_error)
    )
    if config.force_weight > 0.0 and force > config.force_free:
        cost += config.force_weight * (force - config.force_free)
    return (config.bonus if success else 0.0) - cost
