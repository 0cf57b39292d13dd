"""Evaluate a population of models: in this process, in several, or on Ray."""

import contextlib
import multiprocessing
from collections.abc import Sequence
from multiprocessing.connection import wait
from typing import Any, NamedTuple, Protocol

from dovetail.errors import ConfigError, DovetailError, PlantError
from dovetail.identify.recording import Recording
from dovetail.identify.replay import LogReplay, rms_of
from dovetail.interrupt import left_to_the_parent
from dovetail.plants.twin import Twin
from dovetail.types import Array

MAX_DEATHS = 3
"""Most workers that one evaluation may lose before the fit is ended."""


class Population(Protocol):
    """Something that replays many models."""

    deaths: int
    """Times that workers died; their evaluations were done again."""

    def errors(self, models: Sequence[Twin]) -> list[Array | None]:
        """Return `Replay.error` of each model, in order.

        Raises:
            PlantError: Workers die again and again.
        """
        ...

    def close(self) -> None:
        """Release the workers."""
        ...


def evaluate_population(models: Sequence[Twin], population: Population) -> list[float]:
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
        self._replay = LogReplay(recording, engine)

    def errors(self, models: Sequence[Twin]) -> list[Array | None]:
        """Return the error of each model, one after the other."""
        return [self._replay.error(model) for model in models]

    def close(self) -> None:
        """Release the engine."""
        self._replay.close()


class Processes:
    """A replay in each of several processes, which live as long as this object.

    Each has a pipe of its own, so that one which dies takes nothing with it: another
    is started in its place and does its evaluation again.
    """

    def __init__(self, recording: Recording, engine: str, workers: int) -> None:
        """Start the processes."""
        self.deaths = 0
        self._arguments = (recording, engine)
        self._context = multiprocessing.get_context("spawn")
        self._workers = [self._start() for _ in range(workers)]

    def _start(self) -> "_Worker":
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=_work, args=(theirs, *self._arguments), daemon=True
        )
        with left_to_the_parent():
            process.start()
        theirs.close()  # so that the end of the process ends the pipe
        return _Worker(process, ours)

    def errors(self, models: Sequence[Twin]) -> list[Array | None]:
        """Return the error of each model."""
        waiting = list(range(len(models)))[::-1]
        losses = [0] * len(models)
        done: dict[int, Array | None] = {}
        busy: dict[Any, tuple[int, int]] = {}  # pipe -> number of worker, of model
        idle = list(range(len(self._workers)))
        while len(done) < len(models):
            while idle and waiting:
                number, model = idle.pop(), waiting.pop()
                worker = self._workers[number]
                worker.give(models[model])
                busy[worker.pipe] = (number, model)
            for pipe in wait(list(busy)):
                number, model = busy.pop(pipe)
                idle.append(number)
                try:
                    answer = self._workers[number].pipe.recv()
                except (EOFError, OSError):
                    waiting.append(model)
                    losses[model] += 1
                    self._replace(number, losses[model])
                    continue
                if isinstance(answer, DovetailError):
                    raise answer
                done[model] = answer
        return [done[i] for i in range(len(models))]

    def _replace(self, number: int, losses: int) -> None:
        """Start a worker in the place of one that died.

        Raises:
            PlantError: The same evaluation has lost too many.
        """
        self._workers[number].end()
        self.deaths += 1
        if losses > MAX_DEATHS:
            raise PlantError(
                f"{losses} worker processes died at the same evaluation; is the memory "
                "full? Go on with --resume and fewer --workers"
            )
        self._workers[number] = self._start()

    def close(self) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.end()


class _Worker(NamedTuple):
    """One process and our end of its pipe."""

    process: Any
    pipe: Any

    def give(self, model: Twin) -> None:
        # A worker that died is found when its answer is read.
        with contextlib.suppress(OSError):
            self.pipe.send(model)

    def end(self) -> None:
        self.pipe.close()
        self.process.terminate()
        self.process.join()


def _work(pipe: Any, recording: Recording, engine: str) -> None:
    """Answer models with errors until the pipe ends, also by the parent's death."""
    try:
        replay = LogReplay(recording, engine)
    except DovetailError as error:
        pipe.send(error)
        return
    with contextlib.suppress(EOFError, OSError):
        while True:
            pipe.send(replay.error(pipe.recv()))


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
