"""Settings of a learner: task, law, limits and period, each field checked."""

from dataclasses import fields
from typing import Any, TypeVar, get_args

import numpy as np

from dovetail.control.config import PERIOD_MAX, PERIOD_MIN, LimitConfig, OscConfig
from dovetail.control.limits import BOUNDS, SCHEMES
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import FORCE, POSE, TaskSpec
from dovetail.errors import ConfigError
from dovetail.robots.robot import Robot
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.fields import FieldReader
from dovetail.settings import Range, ranges_of, values_of
from dovetail.types import JOINTS

_CHOICES = {"scheme": SCHEMES, "bounds": BOUNDS}

_Config = TypeVar("_Config", OscConfig, LimitConfig)


def write_settings(settings: ControllerSettings, message: pb.Configuration) -> None:
    """Put settings into an empty message."""
    message.task = str(settings.task)
    message.period = settings.period
    _write_config(settings.osc, message.osc)
    _write_config(settings.limits, message.limits)


def read_settings(message: pb.Configuration, robot: Robot) -> ControllerSettings:
    """Return a message's settings.

    Args:
        message: As received.
        robot: No limit may be wider than this robot's.

    Raises:
        FieldError: Names every wrong field.
    """
    reader = FieldReader()
    period = reader.number("period", message, "period", "s", (PERIOD_MIN, PERIOD_MAX))
    task = _read_task(message.task, reader)
    osc = _read_config(OscConfig, message.osc, "osc", reader)
    limits = _read_config(LimitConfig, message.limits, "limits", reader)
    if limits is not None:
        _require_inside(limits, robot, reader)
    reader.finish()
    assert osc is not None
    assert limits is not None
    assert task is not None
    return ControllerSettings(osc=osc, limits=limits, task=task, period=period)


def _write_config(config: OscConfig | LimitConfig, settings: Any) -> None:
    for name, value in values_of(config).items():
        if isinstance(value, bool):
            settings.add(name=name, is_on=value)
        elif isinstance(value, str):
            settings.add(name=name, choice=value)
        else:
            settings.add(name=name, numbers=np.atleast_1d(value).tolist())


def _read_task(text: str, reader: FieldReader) -> TaskSpec | None:
    try:
        task = TaskSpec.parse(text)
    except ConfigError as error:
        reader.refuse("task", f"wrong: {error}", "such as 'XYZ:force A:pose BC:hold'")
        return None
    if not task.axes(FORCE) and not task.axes(POSE):
        reader.refuse(
            "task",
            f"{text!r}, which commands no axis",
            "at least one axis with mode force or pose",
        )
    return task


def _read_config(
    kind: type[_Config], settings: Any, path: str, reader: FieldReader
) -> _Config | None:
    wrong = len(reader.wrong)
    known = {f.name: f.type for f in fields(kind)}
    given = {setting.name: setting for setting in settings}
    for name in given.keys() - known.keys():
        reader.refuse(f"{path}.{name}", "unknown", ", ".join(known))
    if len(given) < len(settings):
        reader.refuse(path, "given with a name twice", "each name once")
    values = {
        name: _read_setting(name, wanted, given.get(name), path, reader)
        for name, wanted in known.items()
    }
    if len(reader.wrong) > wrong:
        return None
    try:
        return kind(**values)
    except ConfigError as error:
        reader.refuse(path, f"wrong: {error}", "settings that fit together")
        return None


def _read_setting(
    name: str, kind: Any, setting: pb.Setting | None, path: str, reader: FieldReader
) -> Any:
    path, sent = f"{path}.{name}", setting or pb.Setting()
    for allowed in get_args(kind)[1:]:
        if isinstance(allowed, Range):
            labels = allowed.labels or ("",)
            bounds = (allowed.low, allowed.high)
            array = reader.vector(path, sent.numbers, labels, allowed.unit, bounds)
            return array if allowed.labels else float(array[0])
    if kind is bool:
        if not sent.HasField("is_on"):
            reader.refuse(path, "missing", "on or off")
        return sent.is_on
    if sent.choice not in _CHOICES[name]:
        value = repr(sent.choice) if sent.choice else "missing"
        reader.refuse(path, value, ", ".join(_CHOICES[name]))
    return sent.choice


def _require_inside(limits: LimitConfig, robot: Robot, reader: FieldReader) -> None:
    """Refuse limits that are wider than the robot's own."""
    own, ranges = robot.limits, ranges_of(LimitConfig)
    lowest = {
        **dict.fromkeys(("dq_max", "tau_max", "taper_brake", "dtau_max"), 0.0),
        "q_min": own.q_min,
        "q_max": own.q_min,
    }
    for name, low in lowest.items():
        high = own.q_max if name == "q_min" else vars(own)[name]
        unit = ranges[name].unit
        reader.vector(
            f"limits.{name}",
            vars(limits)[name].tolist(),
            JOINTS,
            unit,
            (low, high),
        )
