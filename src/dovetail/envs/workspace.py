"""Whether an arm is built for the task, and the hole lies where it may work."""

from dovetail.arms.arm import Arm
from dovetail.control.task_spec import TaskSpec
from dovetail.errors import ConfigError
from dovetail.poses import Pose, matrix_from_quat
from dovetail.scene import SceneConfig

Walls = tuple[tuple[float, ...], tuple[float, ...]]
"""Lower and upper walls of the TCP [m], world axes."""


def require_inside(scene: SceneConfig, arm: Arm, walls: Walls, hole: Pose) -> None:
    """Refuse a hole whose mouth or floor the arm's limits keep the peg from.

    Args:
        scene: Geometry of the hole.
        arm: The arm.
        walls: Walls of the TCP [m].
        hole: The hole's pose.

    Raises:
        ConfigError: Names the axis, by how much it lies outside, and what is allowed.
    """
    scene.require_reachable(arm.facts.robot, hole)
    axis = matrix_from_quat(hole.quat_wxyz)[:, 2]
    bottom = hole.position - scene.hole_depth * axis
    low, high = walls
    room = scene.hole_depth - scene.success_depth
    margin = max(0.005, arm.facts.limits.delta_x - room)
    for point, place in ((hole.position, "mouth"), (bottom, "floor")):
        for i, name in enumerate("xyz"):
            excess = max(low[i] - point[i], point[i] - high[i]) + margin
            if excess > 0.0:
                raise ConfigError(
                    f"the hole's {place} has {name} = {point[i]:.4f} m, which is "
                    f"{excess:.4f} m outside the workspace; allowed: "
                    f"{low[i] + margin:g} to {high[i] - margin:g} m; move the hole"
                    f"{_margin_advice(margin)}"
                )


def require_task(arm: Arm, task: TaskSpec) -> None:
    """Refuse an arm that was built for another task.

    Raises:
        ConfigError: Names both.
    """
    own = arm.facts.task
    if own != task:
        raise ConfigError(
            f"the arm's task is '{own}', the environment's is '{task}'; give both the "
            "same"
        )


def _margin_advice(margin: float) -> str:
    """Say what narrows the margin [m] that hardware needs at long periods."""
    if margin < 0.01:
        return ""
    return (
        f", or narrow the limits' margin of {1e3 * margin:g} mm: a control period of 1 "
        "or 2 ms, or margins=model in the address of an arm that is simulated"
    )
