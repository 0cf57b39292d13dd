"""Origin of a result: plant, twin or arm, settings, command, machine."""

import os
import platform
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

from dovetail.arms.address import parse_address
from dovetail.arms.arm_address import ArmAddress
from dovetail.arms.local_address import local_address
from dovetail.control.period import DEFAULT_PERIOD, POLICY_PERIOD
from dovetail.evaluation.config import EvaluationConfig
from dovetail.learn.export import commit, versions
from dovetail.options import option_words
from dovetail.plants.twin import load_twin
from dovetail.plugins import is_robot_text
from dovetail.robots.find import DEFAULT_ROBOT, robot_label, whole_robot
from dovetail.robots.robot import Robot
from dovetail.settings import values_of
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.workcell.cell_config import CellConfig
from dovetail.workcell.workcell import Workcell


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Origin of an evaluation's numbers, and the command that makes them again."""

    config: Mapping[str, Any]
    """The evaluation's settings."""
    policy: Mapping[str, Any]
    """The policy's own description, with its provenance."""
    provenance: Mapping[str, Any]
    """Versions, machine and time of this evaluation."""
    command: str
    """The command that makes this report again."""


def name_ground(config: EvaluationConfig) -> str:
    """Return where a result was found: a twin is called a twin, never a robot."""
    return _address(config).describe_ground()


def _address(config: EvaluationConfig) -> ArmAddress:
    if config.arm is not None:
        return parse_address(config.arm)
    return local_address(config.plant or "", config.twin)


def shared_engine(
    config: EvaluationConfig, policy: Mapping[str, Any], cell: Workcell
) -> str:
    """Say that twin and training had the same physics engine; empty where not.

    Args:
        config: The settings.
        policy: The policy's description.
        cell: Of the tries: PyBullet does not build every part.
    """
    twin = _address(config).twin
    trained_on: Any = policy.get("provenance")
    for key in ("config", "arm"):  # the file may be a stranger's
        trained_on = trained_on.get(key) if isinstance(trained_on, Mapping) else None
    if not twin or trained_on is not None:
        return ""
    engine = load_twin(twin).engine
    if policy["env"].get("plant") != engine:
        return ""
    other = "mujoco" if engine == "bullet" else "bullet"
    if cell.meshes():
        other = "drake" if engine == "mujoco" else "mujoco"
    return (
        f"the policy's training and this twin are both {engine}, which tells less "
        f"about transfer; train with --plant {other}, or try it on a twin whose file "
        f'says engine = "{other}"'
    )


def other_period(period: float, policy: Mapping[str, Any]) -> str:
    """Say that the policy was trained at another control period; empty where not.

    Args:
        period: Control period of the tries [s].
        policy: The policy's description.
    """
    trained = policy["env"].get("period", DEFAULT_PERIOD)
    if period == trained:
        return ""
    return (
        f"the control period is {1e3 * period:g} ms, the policy's training had "
        f"{1e3 * trained:g} ms; its steps are {1e3 * POLICY_PERIOD:g} ms at both"
    )


def other_robot(options: Mapping[str, Any], policy: Mapping[str, Any]) -> str:
    """Say that the policy was trained with another robot; empty where not.

    Args:
        options: Keyword arguments of the environment of the tries.
        policy: The policy's description.
    """
    here = whole_robot(options.get("robot", DEFAULT_ROBOT))
    trained = str(policy["env"].get("robot", DEFAULT_ROBOT))
    if here == trained:
        return ""
    return (
        f"the robot of the tries is {robot_label(here)}, that of the policy's "
        f"training {robot_label(trained)}"
    )


def lacking_inertia(config: EvaluationConfig, robot: Robot) -> str:
    """Say that the twin's inertia set is of another robot; empty where it is not."""
    twin = _address(config).twin
    return load_twin(twin).lacks(robot) if twin else ""


def describe_origin(
    config: EvaluationConfig,
    options: Mapping[str, Any],
    poses: Sequence[FixturePose],
    policy: Mapping[str, Any],
    started: datetime,
) -> Origin:
    """Return where an evaluation's numbers come from.

    Args:
        config: The settings, with the folder that is written.
        options: Keyword arguments of the environment.
        poses: Where the fixture is.
        policy: The policy's description.
        started: When the tries began.
    """
    if config.arm is not None:
        arm = {"arm": _address(config).text}  # without its token
        config, options = replace(config, **arm), {**options, **arm}
    return Origin(
        config=describe_settings(config, options, poses),
        policy=_labelled(policy),
        provenance=provenance(started),
        command=command_line(config),
    )


def _labelled(policy: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a policy's description with its robot's name in the place of its text.

    The text, several thousand characters, stays in the policy's own file.
    """
    robot = policy["env"].get("robot", "")
    if not is_robot_text(robot):
        return policy
    label = robot_label(robot)

    def named(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: named(entry) for key, entry in value.items()}
        if isinstance(value, str):
            typed = shlex.quote(f"FILE of {label}")
            return value.replace(shlex.quote(robot), typed).replace(robot, label)
        return value

    return named(policy)


def describe_settings(
    config: EvaluationConfig, options: Mapping[str, Any], poses: Sequence[FixturePose]
) -> dict[str, Any]:
    """Return everything that was asked for, for a report.

    Args:
        config: The settings.
        options: Keyword arguments of the environment.
        poses: Where the fixture is.
    """
    settings = values_of(config)
    settings |= settings.pop("task_options")
    settings["environment"] = dict(options)
    if "robot" in options:
        settings["environment"]["robot"] = robot_label(options["robot"])
    for table in (settings, settings["environment"]):
        if isinstance(cell := table.get("cell"), CellConfig):
            table["cell"] = cell.table()
    is_tilted = any(pose.b or pose.c for pose in poses)
    tilt = ", B C [rad]" if is_tilted else ""
    settings[f"fixture poses (x y z [m], theta [rad]{tilt})"] = {
        pose.name: f"{pose.x:g} {pose.y:g} {pose.z:g}, {pose.theta:g}"
        + (f", {pose.b:g} {pose.c:g}" if is_tilted else "")
        for pose in poses
    }
    if config.twin is not None:
        settings["twin file"] = load_twin(config.twin).table()
    return {name: value for name, value in settings.items() if value is not None}


_ALWAYS = ("tries", "seed")
_ASIDE = ("policy", "task_options", "out", "workers", "keep_logs")
"""Settings that have words of their own, or on which the outcome does not depend."""


def command_line(config: EvaluationConfig) -> str:
    """Return the command that makes an evaluation again, its folder aside."""
    usual = values_of(EvaluationConfig(policy=config.policy))
    given = {
        name: value
        for name, value in values_of(config).items()
        if name in _ALWAYS or (name not in _ASIDE and value != usual[name])
    }
    words = ["dovetail", "evaluate", config.policy]
    if config.cell is not None:
        given["cell"] = config.cell.file
    for name, value in (given | config.task_options).items():
        words += option_words(name, value)
    return shlex.join(words)


def provenance(started: datetime) -> dict[str, Any]:
    """Return what a number depends on besides its settings: versions and machine."""
    seconds = (datetime.now(UTC) - started).total_seconds()
    return {
        "started (UTC)": started.isoformat(timespec="seconds"),
        "duration [s]": round(seconds, 1),
        "versions": versions(),
        "commit": commit() or "installed package, no checkout",
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()}",
    }
