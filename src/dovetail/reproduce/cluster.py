"""Stages as tasks of a Ray cluster; the only file here that knows Ray.

The results folder must be at the same path on every machine (a shared file system). A
task whose machine dies is started again by Ray, and goes on from its checkpoint.
"""

import contextlib
import logging
import os
import socket
from pathlib import Path
from typing import Any

from dovetail.errors import (
    ConfigError,
    DovetailError,
    MissingDependencyError,
    install_command,
)
from dovetail.reproduce.executor import StageJob, start_process
from dovetail.reproduce.stage import STAGE, stage_folder

LOCAL = "local"
"""The address that starts Ray on this machine."""
NOT_STARTED = "Ray did not start on this machine"
_ANSWERS = 5.0
"""Longest wait for a cluster's answer [s]."""
RETRIES = 3
"""Number of restarts of a task whose machine or worker dies."""
NOT_SHARED = 111
"""Exit code of a task that does not see the results folder."""
LOST = 112
"""Exit code of a task that Ray has given up."""


def run_task(root: str, name: str) -> int:
    """Run one stage on the machine that Ray chose; return its exit code."""
    if not (stage_folder(Path(root), name) / STAGE).is_file():
        return NOT_SHARED
    return start_process(Path(root), name).wait()


def _import_ray() -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError as error:
        raise MissingDependencyError(
            f"--cluster needs Ray ({error}): {install_command('cluster')}"
        ) from error
    return ray


def _start_here(ray: Any, options: dict[str, Any]) -> None:
    """Start Ray on this machine; a second attempt finds its files in memory.

    Raises:
        DovetailError: It does not come up in time.
    """
    for attempt in (1, 2):
        try:
            ray.init(LOCAL, include_dashboard=False, **options)
        except Exception as error:  # Ray raises no narrower one
            ray.shutdown()
            if attempt == 2:
                raise DovetailError(
                    f"{NOT_STARTED} ({str(error).strip().splitlines()[0]}): Ray gives "
                    "its agents 15 s to start, which a busy machine may not; leave out "
                    "--cluster, and the stages run as processes of this machine"
                ) from error
        else:
            return


def _require_answer(address: str) -> None:
    """Refuse an address that does not answer in seconds; Ray itself takes minutes.

    Raises:
        ConfigError: Nothing answers at HOST:PORT.
    """
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal():
        return
    try:
        socket.create_connection((host, int(port)), timeout=_ANSWERS).close()
    except (OSError, OverflowError) as error:
        raise _no_cluster(address, error) from error


def _no_cluster(address: str, error: Exception) -> ConfigError:
    first = str(error).strip().splitlines()[0]
    return ConfigError(
        f"no Ray cluster at {address!r} ({first}); start one with 'ray start --head', "
        f"or give --cluster {LOCAL}"
    )


class _Task:
    """A job that is a task of Ray."""

    def __init__(self, ray: Any, reference: Any) -> None:
        self._ray = ray
        self._reference = reference

    def poll(self) -> int | None:
        ready, _ = self._ray.wait([self._reference], timeout=0)
        if not ready:
            return None
        try:
            return int(self._ray.get(self._reference))
        except self._ray.exceptions.RayError:
            return LOST

    def stop(self) -> None:
        with contextlib.suppress(self._ray.exceptions.RayError, ValueError):
            self._ray.cancel(self._reference, force=True)


class RayExecutor:
    """Runs stages on a Ray cluster, as many at once as it has cores."""

    def __init__(self, address: str, workers: int | None = None) -> None:
        """Join the cluster at an address, or start one here.

        Args:
            address: `local`, `auto`, HOST:PORT or ray://HOST:PORT.
            workers: Stages at once; None is the cluster's cores.

        Raises:
            MissingDependencyError: The extra `cluster` is not installed.
            ConfigError: Nothing answers at the address.
            DovetailError: Ray does not start on this machine.
        """
        self._ray = ray = _import_ray()
        _require_answer(address)
        options: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
        if address == LOCAL:
            options["num_cpus"] = workers or len(os.sched_getaffinity(0))
            _start_here(ray, options)
        else:
            try:
                ray.init(address, **options)
            except (ConnectionError, ValueError, RuntimeError) as error:
                raise _no_cluster(address, error) from error
        logging.getLogger("ray").setLevel(logging.ERROR)
        cores = int(ray.cluster_resources().get("CPU", 1))
        self.slots = max(1, min(workers or cores, cores))
        self._task = ray.remote(num_cpus=1, max_retries=RETRIES)(run_task)

    def start(self, root: Path, name: str) -> StageJob:
        """Start a stage whose folder holds its stage.json."""
        return _Task(self._ray, self._task.remote(str(root), name))

    def close(self) -> None:
        """Leave the cluster; one that was started here ends."""
        self._ray.shutdown()
