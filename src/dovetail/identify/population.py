"""Evaluate a population of models: in this process, in several, or on Ray."""

import multiprocessing
import os
import threading
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from typing import Protocol

import numpy as np

from dovetail.errors import ConfigError, PlantError
from dovetail.identify.recording import Recording
from dovetail.identify.replay import Replay, rms_of
from dovetail.plants.twin import TwinConfig
from dovetail.types import Array

MAX_DEATHS = 3
"""How often in one population a worker may die before the fit is ended."""


class Population(Protocol):
    """Something that replays many models."""

    deaths: int
    """Times that workers died; their evaluations were done again."""

    def errors(self, models: Sequence[TwinConfig]) -> list[Array | None]:
        """Return `Replay.error` of each model, in order.

        Raises:
            PlantError: Workers die again and again.
        """
        ...

    def close(self) -> None:
        """Release the workers."""
        ...


def evaluate_population(
    models: Sequence[TwinConfig], population: Population
) -> list[float]:
    """Return the RMS error of each model [m], in order.

    Raises:
        PlantError: Workers die again and again.
    """
    return [rms_of(error) for error in population.errors(models)]


class Here:
    """One replay, in this process."""

    deaths = 0

    def __init__(self, recording: Recording, engine: str) -> None:
        """Build the replay."""
        self._replay = Replay(recording, engine)

    def errors(self, models: Sequence[TwinConfig]) -> list[Array | None]:
        """Return the error of each model, one after the other."""
        return [self._replay.error(model) for model in models]

    def close(self) -> None:
        """Release the engine."""
        self._replay.close()


class Processes:
    """A replay in each of several processes, which live as long as this object."""

    def __init__(self, recording: Recording, engine: str, workers: int) -> None:
        """Start the processes."""
        self.deaths = 0
        self._arguments = (recording, engine)
        self._workers = workers
        self._pool = self._start()

    def _start(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self._workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
            initargs=self._arguments,
        )

    def errors(self, models: Sequence[TwinConfig]) -> list[Array | None]:
        """Return the error of each model.

        Where a worker dies, the pool is built again and what is missing is evaluated
        again.
        """
        done: dict[int, Array | None] = {}
        for _ in range(MAX_DEATHS + 1):
            left = [i for i in range(len(models)) if i not in done]
            if not left:
                return [done[i] for i in range(len(models))]
            try:
                futures = {
                    i: self._pool.submit(_replay_in_worker, models[i]) for i in left
                }
                for i, future in futures.items():
                    error = future.result()
                    done[i] = None if error is None else error.astype(np.float64)
            except BrokenProcessPool:
                self.deaths += 1
                self._pool.shutdown(wait=False, cancel_futures=True)
                self._pool = self._start()
        raise PlantError(
            f"a worker process died {MAX_DEATHS + 1} times while "
            f"{len(models)} models were simulated; is the memory full? Go on with "
            "--resume and fewer --workers"
        )

    def close(self) -> None:
        """End the processes."""
        self._pool.shutdown(wait=True, cancel_futures=True)


_of_this_process: list[Replay] = []


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)


def _start_worker(recording: Recording, engine: str) -> None:
    # A parent that was killed cannot end its workers, and they would wait for ever.
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _of_this_process.append(Replay(recording, engine))


def _replay_in_worker(model: TwinConfig) -> Array | None:
    return _of_this_process[0].error(model)


def make_population(
    recording: Recording, engine: str, workers: int, cluster: str | None = None
) -> Population:
    """Choose where a population is evaluated.

    Args:
        recording: What is replayed.
        engine: Physics engine.
        workers: Processes on this machine, at least 1; 1 stays in this one.
        cluster: Address of a Ray cluster, or "local" to start one on this machine;
            None is no cluster.

    Raises:
        ConfigError: Workers below 1, or no cluster at that address.
        MissingDependencyError: The engine, or Ray, is not installed.
    """
    if workers < 1:
        raise ConfigError(f"workers is {workers}; needs at least 1")
    if cluster is not None:
        from dovetail.identify.cluster import RayTasks

        return RayTasks(recording, engine, cluster)
    if workers == 1:
        return Here(recording, engine)
    return Processes(recording, engine, workers)
