"""With which gains an arm is felt, and how a simulated one steps."""

from dataclasses import replace

from dovetail.control.config import LimitConfig, OscConfig
from dovetail.feel.excitation import STIFFNESS
from dovetail.plants.plant import DynamicsConfig, physics_steps

QUIET_RATE = 20.0
"""Bandwidth of the disturbance estimate while an arm is felt [1/s]: it then bears a
delay of 40 ms."""


def quiet(osc: OscConfig, limits: LimitConfig) -> tuple[OscConfig, LimitConfig]:
    """Return settings with which an arm of any delay can be felt, wherever it is."""
    return (
        replace(osc, joint_stiffness=STIFFNESS),
        replace(limits, walls=False, estimate_rate=QUIET_RATE),
    )


def simulated_step(period: float) -> float:
    """Return the physics step [s] of a simulated arm at a control period [s]."""
    return period / physics_steps(period, DynamicsConfig().physics_dt)
