"""What a training and an export say about the environment, written once."""

from dataclasses import dataclass
from typing import Any

from dovetail.control.period import DEFAULT_PERIOD
from dovetail.control.period_option import Period
from dovetail.envs import usual
from dovetail.envs.peg_in_hole import PegInHoleEnv
from dovetail.envs.registered import environment_class

ENV_FIELDS = (
    *("plant", "peg", "clearance", "task", "stack", "period"),
    *("f_scale", "f_scale_angular", "force_damping", "tare"),
    *("near_speed", "near_press", "near_distance"),
    *("theta_range", "position_range", "max_steps", "scheme"),
)
"""Fields that are handed to the environment as they are."""


@dataclass(frozen=True, kw_only=True)
class EnvSettings:
    """The environment of a policy."""

    env: str = "dovetail/PegInHole-v0"
    """Gymnasium id of the environment."""
    plant: str = "mujoco"
    """Physics engine to train in: mujoco or bullet."""
    peg: str = "square"
    """Shape of peg and hole: square, triangle (MuJoCo only) or round."""
    clearance: float | None = None
    """Gap between peg and hole on each side [m]; default the environment's: 0.0005 in
    peg in hole, 0.001 for the rail clip."""
    task: str | None = None
    """Mode of each axis: force, pose, hold or free; default the environment's: "XYZ:
    force A:pose BC:hold" in peg in hole, "X:force A:pose YZBC:hold" for the clip."""
    stack: int = 0
    """Number of past (observation, action) pairs in the observation."""
    period: Period = DEFAULT_PERIOD
    """Control period: 1ms, 2ms, 2.5ms or 5ms; an action acts for 50 ms at any of them.
    An arm's address may give its own."""
    f_scale: tuple[float, ...] = (usual.F_SCALE,)
    """f* at action 1 on X Y Z [m/s2]: one number, or three."""
    f_scale_angular: float = usual.F_SCALE_ANGULAR
    """f* at action 1 on A B C [rad/s2]."""
    force_damping: tuple[float, ...] = (usual.FORCE_DAMPING,)
    """Damping D of force axes X Y Z [1/s], one number or three: f_scale / D is the top
    speed. The paper has 0, and nothing near contact: near_speed 0.25, near_press of
    f_scale, no tare."""
    tare: bool = True
    """Before each episode measure, in free air, the weight that gravity compensation
    misses, and take it off what the policy commands: in training with `model`,
    `randomise_dynamics` or `arm`, as there is none in the nominal model; and wherever
    the policy is evaluated."""
    near_speed: float = usual.NEAR_SPEED
    """Speed limit of the tool per axis where contact is near [m/s]."""
    near_press: float = usual.NEAR_PRESS
    """Largest f* towards the hole there [m/s2]: about a tenth of the newtons with which
    the tool can stand on the rim."""
    near_distance: float = usual.NEAR_DISTANCE
    """How far above the hole's mouth that begins [m]."""
    theta_range: float = usual.THETA_RANGE
    """Rotation at action 1 on pose axes A B C [rad]."""
    position_range: float = usual.POSITION_RANGE
    """Displacement at action 1 on pose axes X Y Z [m]."""
    max_steps: int = 200
    """Actions per episode."""
    scheme: str = "qp"
    """How the controller keeps its limits: qp or paper."""

    @property
    def environment(self) -> type[PegInHoleEnv]:
        """The environment's class.

        Raises:
            ConfigError: No such environment; lists the known ones.
        """
        return environment_class(self.env)

    def env_options(self) -> dict[str, Any]:
        """Return the keyword arguments of the environment, as JSON knows them."""
        return {name: getattr(self, name) for name in ENV_FIELDS} | self._own()

    def _own(self) -> dict[str, Any]:
        """Return what is not given and so is the environment's own."""
        own = self.environment.defaults
        return {name: own[name] for name in own if getattr(self, name) is None}
