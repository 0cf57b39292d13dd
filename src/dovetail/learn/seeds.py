"""Several seeds of one training run, each in a process of its own."""

import json
import multiprocessing
import os
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console

from dovetail.errors import DovetailError
from dovetail.files import write_atomic
from dovetail.interrupt import Event, Interrupt, ends_whole, left_to_the_parent
from dovetail.learn.config import TrainConfig
from dovetail.learn.one_run import CUT_SHORT, TrainResult, prepared, train_one
from dovetail.learn.progress import ProgressBar
from dovetail.learn.run_folder import CONFIG, EVALUATION, open_run, require_run

_Result = TypeVar("_Result")


def train_seeds(
    config: TrainConfig, console: Console, begin: Callable[[Path], None]
) -> list[TrainResult]:
    """Train each of the seeds, as many at once as this process may use cores.

    Args:
        config: Settings; seed and sub-folder of each run follow from it.
        console: Where the bars go.
        begin: Told the folder of all runs as soon as it is there.

    Returns:
        One result per seed, in order.

    Raises:
        DovetailError: A seed failed (says which); the others were finished first.
        KeyboardInterrupt: Ctrl-C; each seed that ran has saved a checkpoint.
    """
    require_run(config)
    runs = [config.for_seed(config.seed + i) for i in range(config.seeds)]
    runs = [
        replace(run, resume=config.resume and (run.folder / CONFIG).exists())
        for run in runs
    ]
    cores = len(os.sched_getaffinity(0))
    workers = min(len(runs), cores)
    if not config.threads and config.is_batch:
        runs = [replace(run, threads=cores // workers) for run in runs]
    context = multiprocessing.get_context("spawn")
    channel, told = context.Queue(), context.Event()
    names = [f"seed {run.seed}" for run in runs]
    with (
        ProgressBar(config.steps, names, console) as bar,
        ProcessPoolExecutor(
            workers, context, _start, (channel, told, os.getpid())
        ) as pool,
    ):
        with left_to_the_parent():  # starts all the processes
            first = pool.submit(_try, runs[0])
        _result(first, runs[0])
        folder = open_run(config)
        begin(folder)
        with ends_whole(CUT_SHORT) as interrupt:
            futures = [pool.submit(_train, i, run) for i, run in enumerate(runs)]
            _show(channel, futures, bar, interrupt, told)
    interrupt.check()
    results = [_result(future, run) for future, run in zip(futures, runs, strict=True)]
    _summarise(folder, runs, results)
    return results


def _show(
    channel: Any,
    futures: list[Future[TrainResult]],
    bar: ProgressBar,
    interrupt: Interrupt,
    told: Event,
) -> None:
    """Pass on what the processes say, and Ctrl-C to them, until all are done."""
    is_done = False
    while not is_done:
        if interrupt.is_pressed() and not told.is_set():
            told.set()
            for future in futures:
                future.cancel()  # one that has not begun
        is_done = all(future.done() for future in futures)
        try:
            while True:
                bar.show(*channel.get(timeout=0.2))
        except queue.Empty:
            pass


def _result(future: Future[_Result], run: TrainConfig) -> _Result:
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise DovetailError(
            f"the process of seed {run.seed} died (killed, or out of memory); "
            "continue with --resume"
        ) from error
    except DovetailError as error:
        raise type(error)(f"seed {run.seed}: {error}") from error


def _summarise(
    folder: Path, runs: list[TrainConfig], results: list[TrainResult]
) -> None:
    summary = {
        f"seed-{run.seed}": {
            "steps": result.steps,
            "wall_time_s": round(result.wall_time, 1),
            "evaluation": result.evaluation,
        }
        for run, result in zip(runs, results, strict=True)
    }
    write_atomic(folder / EVALUATION, json.dumps(summary, indent=2) + "\n")


_channel: list[Any] = []
_told: list[Event] = []


def _start(channel: Any, told: Event, parent: int) -> None:
    """Prepare a worker: where to report to, and to end when the parent is gone."""
    _channel.append(channel)
    _told.append(told)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def _try(config: TrainConfig) -> None:
    """Build everything and throw it away: what fails does so before there is a run."""
    with prepared(config):
        pass


def _train(index: int, config: TrainConfig) -> TrainResult:
    interrupt = Interrupt(_told[0])
    return train_one(
        config,
        lambda status: _channel[0].put((index, status)),
        interrupt=interrupt,
    )
