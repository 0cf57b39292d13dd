"""The arm that a training is on, or the dynamics of the one that it simulates."""

from functools import cached_property
from pathlib import Path
from typing import Self

from pydantic import model_validator

from dovetail.envs.dynamics_randomisation import DynamicsRandomisation
from dovetail.errors import ConfigError
from dovetail.learn.model_file import ModelFile
from dovetail.options import Placement
from dovetail.settings import settings

_USUAL = DynamicsRandomisation()


@settings()
class ArmPlaceConfig:
    """An arm in place of a simulation, and where its fixture is."""

    arm: str | None = None
    """Arm in place of a plant: twin:NAME, fri://HOST:PORT or grpc://HOST:PORT. It is
    one arm, and mujoco and bullet are addresses, too."""
    approach: bool = False
    """Let an arm behind fri:// go to its first start from afar, slowly. Afar is more
    than 0.15 m or 0.5 rad; it goes up, across and down."""
    fixed_goal: bool = False
    """Keep the fixture where `fixture` says, for an arm that cannot move it."""
    fixture: Placement = None
    """Place of its frame: x y z [m], yaw [rad], world axes; two more numbers are its
    tilts B C [rad], about y and x. Needs `fixed_goal`; default the first pose in
    which the task's policies are tried."""


@settings()
class SimulatedDynamicsConfig:
    """Dynamics of the simulation."""

    model: Path | None = None
    """Model of the arm to simulate, a file of `dovetail identify fit`. Any twin file is
    one: the engine takes its dynamics and delay. Without it the nominal model."""
    randomise_dynamics: bool = False
    """Draw the dynamics anew in every episode, as the next four say. They are gravity,
    link masses, joint damping and surface friction, about the model's."""
    random_gravity: float = _USUAL.gravity
    """Half range of gravity's residual on each of x y z [m/s2], uniform."""
    random_mass: tuple[float, float] = _USUAL.mass
    """Range of the factor on each link's mass and inertia [1]. Uniform."""
    random_damping: tuple[float, float] = _USUAL.damping
    """Range of the factor on each joint's damping [1], log-uniform."""
    random_friction: tuple[float, float] = _USUAL.friction
    """Range of the contacts' friction coefficient [1], uniform."""

    @model_validator(mode="after")
    def _check_simulated_dynamics_config(self) -> Self:
        """Refuse ranges that nothing would simulate."""
        if self.ranges != _USUAL and not self.randomise_dynamics:
            raise ConfigError(
                "a range of random dynamics is given, which needs --randomise-dynamics"
            )
        return self

    @cached_property
    def model_file(self) -> ModelFile | None:
        """The model's content when these settings were made."""
        return None if self.model is None else ModelFile.load(self.model.expanduser())

    @property
    def ranges(self) -> DynamicsRandomisation:
        """The ranges as the environment takes them."""
        return DynamicsRandomisation(
            gravity=self.random_gravity,
            mass=self.random_mass,
            damping=self.random_damping,
            friction=self.random_friction,
        )
