"""Evaluate a population of models: in this process, in several, or on Ray."""

import multiprocessing
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, Protocol, Self

from dovetail.errors import ConfigError, MissingDependencyError, PlantError
from dovetail.identify.recording import Recording
from dovetail.identify.replay import Replay
from dovetail.plants.twin import TwinConfig

_MAX_DEATHS = 3
"""How often an evaluation may lose its worker before the fit is ended."""


class Population(Protocol):
    """Something that says how far each of many models is from the recording."""

    deaths: int
    """Workers that died; their evaluations were done again."""

    def evaluate(self, models: Sequence[TwinConfig]) -> list[float]:
        """Return the RMS error of each model [m], in order.

        Raises:
            PlantError: An evaluation lost its worker again and again.
        """
        ...

    def close(self) -> None:
        """Release the workers."""
        ...


class Here:
    """One replay in this process."""

    deaths = 0

    def __init__(self, folder: Path, engine: str) -> None:
        """Load the recording."""
        self._replay = Replay(Recording.load(folder), engine)

    def evaluate(self, models: Sequence[TwinConfig]) -> list[float]:
        """Return the RMS error of each model [m], one after the other."""
        return [self._replay.rms(model) for model in models]

    def close(self) -> None:
        """Release the engine."""
        self._replay.close()


class Processes:
    """A replay in each of several processes, which live as long as this object."""

    def __init__(self, folder: Path, engine: str, workers: int) -> None:
        """Start the processes."""
        self.deaths = 0
        self._arguments = (folder, engine)
        self._workers = workers
        self._pool = self._start()

    def _start(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self._workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
            initargs=self._arguments,
        )

    def evaluate(self, models: Sequence[TwinConfig]) -> list[float]:
        """Return the RMS error of each model [m].

        Where a worker dies, the pool is built again and what is missing is evaluated
        again.
        """
        values: dict[int, float] = {}
        for _ in range(_MAX_DEATHS + 1):
            left = [i for i in range(len(models)) if i not in values]
            if not left:
                break
            try:
                futures: dict[int, Future[float]] = {
                    i: self._pool.submit(_rms_in_worker, models[i]) for i in left
                }
                for i, future in futures.items():
                    values[i] = future.result()
            except BrokenProcessPool:
                self.deaths += 1
                self._pool.shutdown(wait=False, cancel_futures=True)
                self._pool = self._start()
        if len(values) < len(models):
            raise PlantError(
                f"{len(models) - len(values)} evaluations lost their worker process "
                f"{_MAX_DEATHS + 1} times; is the memory full? Use fewer --workers, and "
                "--resume to go on"
            )
        return [values[i] for i in range(len(models))]

    def close(self) -> None:
        """End the processes."""
        self._pool.shutdown(wait=False, cancel_futures=True)


_of_this_process: list[Replay] = []


def _start_worker(folder: Path, engine: str) -> None:
    _of_this_process.append(Replay(Recording.load(folder), engine))


def _rms_in_worker(model: TwinConfig) -> float:
    return _of_this_process[0].rms(model)


def make_population(
    folder: Path, engine: str, workers: int, cluster: str | None
) -> Population:
    """Choose how a population is evaluated.

    Args:
        folder: The recording.
        engine: Physics engine.
        workers: Processes on this machine, at least 1.
        cluster: Ray's address, or "local" for one on this machine; None is none.
    """
    if workers < 1:
        raise ConfigError(f"workers is {workers}; needs at least 1")
    if cluster is not None:
        raise MissingDependencyError("no ray yet")
    return Here(folder, engine) if workers == 1 else Processes(folder, engine, workers)
