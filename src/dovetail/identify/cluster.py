"""Replays on a Ray cluster: a laboratory's computers instead of one."""

import os
import socket
from collections.abc import Sequence
from typing import Any

from dovetail.errors import (
    ConfigError,
    MissingDependencyError,
    PlantError,
    install_command,
)
from dovetail.identify.recording import Recording
from dovetail.identify.replay import LogReplay
from dovetail.plants.twin import Twin
from dovetail.types import Array

_TIMEOUT = 5.0
"""Longest wait for the head of a cluster to answer [s]."""
_RETRIES = 3
"""Most repeats by Ray of an evaluation whose worker or machine has died."""


class RayTasks:
    """Each evaluation is a task; Ray does it again where its worker dies.

    Every machine of the cluster needs this dovetail. A worker builds its replay once,
    with the first task it gets.
    """

    deaths = 0
    """Not counted here: Ray repeats such tasks itself, and its log names them."""

    def __init__(self, recording: Recording, engine: str, address: str) -> None:
        """Connect to a cluster, or start one.

        Args:
            recording: What is replayed; sent to each machine once.
            engine: Physics engine.
            address: HOST:PORT, ray://HOST:PORT, "auto", or "local" for one of this
                machine alone.

        Raises:
            MissingDependencyError: Ray is not installed.
            ConfigError: No cluster there.
        """
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        try:
            import ray
        except ImportError as error:
            raise MissingDependencyError(
                f"a fit on a cluster needs Ray: {install_command('cluster')}, or leave "
                "--cluster out"
            ) from error
        self._ray: Any = ray
        self._is_own = not ray.is_initialized()
        if self._is_own:
            self._connect(address)
        self._key = f"{recording.fingerprint()}-{engine}"
        self._engine = engine
        self._recording = ray.put(recording)
        self._task: Any = ray.remote(max_retries=_RETRIES)(_replay_in_task)

    def _connect(self, address: str) -> None:
        _require_listener(address)
        options: dict[str, Any] = {"include_dashboard": False}
        try:
            self._ray.init(
                address=address,
                log_to_driver=False,
                logging_level="ERROR",
                **(options if address == "local" else {}),
            )
        except (ConnectionError, RuntimeError, ValueError, OSError) as error:
            raise ConfigError(
                f"no Ray cluster answers at {address!r}: {error}; start one with `ray "
                "start --head`, or give --cluster local"
            ) from error

    def errors(self, models: Sequence[Twin]) -> list[Array | None]:
        """Return the error of each model."""
        tasks = [
            self._task.remote(self._key, self._recording, self._engine, model)
            for model in models
        ]
        try:
            return [
                None if error is None else error.copy()  # Ray's own memory is read-only
                for error in self._ray.get(tasks)
            ]
        except self._ray.exceptions.WorkerCrashedError as error:
            raise PlantError(
                f"a worker of the cluster died {_RETRIES + 1} times in one evaluation: "
                f"{error}; is its memory full? Go on with --resume"
            ) from error

    def close(self) -> None:
        """Leave the cluster; one that was started here ends."""
        if self._is_own:
            self._ray.shutdown()


def _require_listener(address: str) -> None:
    """Refuse an address at which nothing listens: Ray itself would try for minutes."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon:
        return  # local, auto
    try:
        socket.create_connection((host, int(port)), timeout=_TIMEOUT).close()
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"no Ray cluster answers at {address!r}: {error}; start one with `ray "
            "start --head`, or give --cluster local"
        ) from error


_replays: dict[str, LogReplay] = {}


def _replay_in_task(
    key: str, recording: Recording, engine: str, model: Twin
) -> Array | None:
    if key not in _replays:
        _replays.clear()
        _replays[key] = LogReplay(recording, engine)
    return _replays[key].error(model)
