"""Requests to a running cabinet: JSON objects in, JSON objects out."""

from collections.abc import Callable
from typing import Any

import numpy as np

from dovetail.cabinet.faults import FaultConfig, parse_faults
from dovetail.cabinet.robot_controller import RobotController
from dovetail.errors import ConfigError, DovetailError
from dovetail.poses import Pose
from dovetail.robots.robot_text import read_robot_text
from dovetail.robots.same_robot import difference
from dovetail.types import Array

GRASP_MAX = 0.02
"""Largest displacement of the held part [m]: a finger's width."""
MAX_FIXTURE_SPEED = 1.0
"""Fastest that a fixture may move [m/s]."""


def numbers(request: dict[str, Any], name: str, count: int) -> Array:
    """Read a list of finite numbers.

    Raises:
        ConfigError: It is missing, of another length, or holds something else.
    """
    values = request.get(name)
    if not isinstance(values, list) or len(values) != count:
        raise ConfigError(f"{name} is {_short(values)}; give a list of {count} numbers")
    for i, value in enumerate(values):
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ConfigError(f"{name}[{i}] is {_short(value)}, which is no number")
        if not abs(value) <= 1e6:  # nor nan, nor an integer no float can hold
            raise ConfigError(f"{name}[{i}] is {_short(value)}; give one within 1e6")
    return np.array(values, dtype=float)


def pose(request: dict[str, Any], name: str) -> Pose:
    """Read a pose: {"position": [3], "quat_wxyz": [4]}.

    Raises:
        ConfigError: It is missing, or no pose.
    """
    table = request.get(name)
    if not isinstance(table, dict):
        raise ConfigError(
            f'{name} is {_short(table)}; give {{"position": [3], "quat_wxyz": [4]}}'
        )
    quat = numbers(table, "quat_wxyz", 4)
    norm = float(np.linalg.norm(quat))
    if not 0.99 < norm < 1.01:
        raise ConfigError(f"{name} quat_wxyz has norm {norm:g}; give a unit quaternion")
    return Pose(numbers(table, "position", 3), quat / norm)


def _number(request: dict[str, Any], name: str) -> float:
    return float(numbers({name: [request.get(name)]}, name, 1)[0])


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


class RequestDesk:
    """Serves requests, in the cabinet's own thread."""

    def __init__(
        self,
        controller: RobotController,
        install_faults: Callable[[FaultConfig], None],
        status: Callable[[], dict[str, Any]],
    ) -> None:
        """Take what the requests are about.

        Args:
            controller: The cabinet without its network.
            install_faults: Puts faults in the place of the present ones.
            status: Everything that can be told.
        """
        self._controller = controller
        self._install_faults = install_faults
        self._actions: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
            "place": self._place,
            "fixture": self._fixture,
            "grasp": self._grasp,
            "push": self._push,
            "io": self._io,
            "fault": self._fault,
            "pause": self._pause,
            "resume": self._resume,
            "stop": self._stop,
            "status": lambda request: status(),
            "truth": lambda request: controller.truth(),
            "agree": self._agree,
        }

    def answer(self, request: Any) -> dict[str, Any]:
        """Do what is asked; a wrong request changes nothing.

        Returns:
            {"ok": true, ...}, or {"ok": false, "error": why}.
        """
        known = ", ".join(self._actions)
        if not isinstance(request, dict):
            error = f'give one JSON object with "do": one of {known}'
            return {"ok": False, "error": error}
        what = request.get("do")
        action = self._actions.get(what) if isinstance(what, str) else None
        if action is None:
            error = f"do is {_short(what)}; known: {known}"
            return {"ok": False, "error": error}
        try:
            return {"ok": True, **action(request)}
        except DovetailError as error:
            return {"ok": False, "error": f"{what}: {error}"}
        except Exception as error:  # no request may end the cabinet
            return {"ok": False, "error": f"{what} failed: {error!r}"}

    def _place(self, request: dict[str, Any]) -> dict[str, Any]:
        seed = request.get("seed")
        if seed is not None and not (type(seed) is int and 0 <= seed < 2**63):
            raise ConfigError(f"seed is {_short(seed)}; give a whole number >= 0")
        self._agree(request)
        self._controller.place(numbers(request, "q", 7), pose(request, "fixture"), seed)
        return self._where()

    def _agree(self, request: dict[str, Any]) -> dict[str, Any]:
        """Refuse a client whose robot or cell file says something else than ours."""
        cell = self._controller.body.plant.cell
        if "robot" in request:
            if not isinstance(text := request["robot"], str):
                raise ConfigError(
                    f"robot is {_short(text)}; give the text of a robot, or leave it "
                    "out: then it is not compared"
                )
            robot = read_robot_text(text)
            if different := difference(robot, cell.robot):
                raise ConfigError(
                    f"the client's robot is {robot.name}, the cabinet's "
                    f"{cell.robot.name}: {different}; start both with the same "
                    "--robot, --env and --cell",
                    name="robot",
                    value=robot.name,
                )
        own = cell.own
        theirs = request.get("cell", own)
        if theirs != own:
            ours = own or "no cell file"
            raise ConfigError(
                f"the client has {str(theirs)[:400] or 'no cell file'}; the "
                f"cabinet has {ours}: start both with the same --cell FILE",
                name="cell",
                value=theirs,
            )
        return {}

    def _fixture(self, request: dict[str, Any]) -> dict[str, Any]:
        fixture, velocity = pose(request, "fixture"), np.zeros(3)
        if request.get("velocity") is not None:
            velocity = numbers(request, "velocity", 3)
            if not (speed := float(np.linalg.norm(velocity))) <= MAX_FIXTURE_SPEED:
                raise ConfigError(
                    f"velocity is {speed:g} m/s; allowed is 0 to "
                    f"{MAX_FIXTURE_SPEED:g} m/s"
                )
        self._controller.body.move_fixture(fixture, velocity)
        return {}

    def _grasp(self, request: dict[str, Any]) -> dict[str, Any]:
        offset = pose(request, "offset")
        if not (far := float(np.linalg.norm(offset.position))) <= GRASP_MAX:
            raise ConfigError(
                f"offset is {far:g} m long; allowed is 0 to {GRASP_MAX:g} m: further, "
                "the part is not between the fingers"
            )
        self._controller.body.grasp(offset)
        return {}

    def _push(self, request: dict[str, Any]) -> dict[str, Any]:
        duration = _number(request, "duration")
        if not 0.0 <= duration <= 3600.0:
            raise ConfigError(f"duration is {duration:g} s; allowed is 0 to 3600 s")
        self._controller.push(numbers(request, "force", 3), duration)
        return {}

    def _io(self, request: dict[str, Any]) -> dict[str, Any]:
        name = request.get("name")
        value = _number(request, "value")
        self._controller.signals.set(name if isinstance(name, str) else "", value)
        return {}

    def _fault(self, request: dict[str, Any]) -> dict[str, Any]:
        text = request.get("text")
        if not isinstance(text, str):
            raise ConfigError(f"text is {_short(text)}; give faults, as loss=0.02")
        self._install_faults(parse_faults(text))
        return {}

    def _pause(self, request: dict[str, Any]) -> dict[str, Any]:
        self._controller.pause()
        return self._where()

    def _resume(self, request: dict[str, Any]) -> dict[str, Any]:
        self._controller.resume()
        return self._where()

    def _stop(self, request: dict[str, Any]) -> dict[str, Any]:
        self._controller.stop()
        return self._where()

    def _where(self) -> dict[str, Any]:
        """Return from which message on the request shows."""
        controller = self._controller
        return {
            "sequence": controller.next_sequence,
            "session": controller.application.sessions,
            "motion": controller.application.motions,
        }
