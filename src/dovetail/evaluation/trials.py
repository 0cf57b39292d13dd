"""Run a policy many times at given poses of the fixture, from seeded starts."""

import math
import multiprocessing
import warnings
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.envs.free_start import StartError
from dovetail.envs.log_facts import (
    SUCCESS,
    describe_cell,
    describe_first,
    observed_columns,
    part_columns,
)
from dovetail.envs.unwrapped import require_contact_env
from dovetail.episode import Episode
from dovetail.errors import ArmError, UnprovenWarning
from dovetail.evaluation.job import TrialJob
from dovetail.evaluation.outcome import (
    ArmStop,
    Conditions,
    ContactForce,
    Course,
    Outcome,
    TryFiles,
)
from dovetail.learn.policy import Actor
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS, FLAG_MASK
from dovetail.poses import UNMOVED, Pose, matrix_from_quat
from dovetail.search.script import CornerScript
from dovetail.settings import in_count
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.types import Array
from dovetail.view.film import Film
from dovetail.view.renderer import Renderer

TRIES_MAX = 100_000
"""Most tries at one pose: a day's work; all are planned before the first one."""
SEED_MAX = 2**63 - 1
"""Largest seed that the simulations' noise takes."""
_BEFORE = ("tare", "motion_ended")
"""Reasons for which a try may end before it begins, and the next one be tried: the tool
did not follow the tare's lead, or the cabinet ended the motion meanwhile."""
_LAST_LINE = (
    "the controller's last line ended the motion: it saw an oscillation, "
    "limiters that drive or push, or a speed that no Target explains (docs/safety.md)"
)
CONTACT_THRESHOLD = 0.1
"""A control cycle with at least this contact force counts as in contact [N]."""


def plan_trials(num_poses: int, tries: int, seed: int) -> list[TrialJob]:
    """Return every try with a seed of its own, in the order of the table.

    Raises:
        ConfigError: `tries` or `seed` is out of range.
    """
    in_count("tries", tries, 1, TRIES_MAX, "at each pose")
    in_count("seed", seed, 0, SEED_MAX, "(2^63 - 1)")
    return [
        TrialJob(pose, attempt, _seed_of(seed, pose, attempt))
        for pose in range(num_poses)
        for attempt in range(tries)
    ]


def _seed_of(seed: int, pose: int, attempt: int) -> int:
    return int(np.random.SeedSequence([seed, pose, attempt]).generate_state(1)[0])


def film_name(pose: FixturePose) -> str:
    """Return the file's name of the film of the first try at a pose."""
    return f"{pose.name}.gif"


class TrialRunner:
    """One environment and one policy, ready for any number of tries."""

    def __init__(
        self,
        make_env: Callable[[], gym.Env],
        load_policy: Callable[[], Actor],
        poses: Sequence[FixturePose],
        logs: Path | None,
        films: Path | None,
    ) -> None:
        """Build the environment and load the policy once.

        Args:
            make_env: Builds the environment; the tries share it.
            load_policy: Loads the policy.
            poses: Poses of the fixture that jobs refer to by index.
            logs: Existing folder for the Episode logs, or None to keep none.
            films: Existing folder for a film of each pose's first try, or None.
        """
        self._policy = load_policy()
        self._env = make_env()
        self._core = require_contact_env(self._env)
        if isinstance(self._policy, CornerScript):
            self._policy.take(self._core)
        self._poses = poses
        self._logs, self._films = logs, films

    def run(self, job: TrialJob) -> Outcome:
        """Run one try from reset to success, time-out or the arm's stop, and log it."""
        fixture = self._poses[job.pose].pose()
        file = self._log_file(job)
        try:
            observation, info = self._env.reset(
                seed=job.seed, options={"fixture": fixture}
            )
        except (ArmError, StartError) as error:
            return self._not_begun(job, fixture, error)
        self._policy.reset()
        perturbation = info.get("perturbation", {})
        tare = np.round(info.get("tare", np.zeros(6)), 3).tolist()
        blocks: list[Array] = []
        film = Film()
        film.add(self._core.state, self._core.fixture, self._core.believed)
        steps, violations = 0, int(info.get("limit_violations", 0))
        done, stopped, said = False, "", ""
        about = self._describe(job) | {"tare [m/s2, rad/s2]": tare}
        about |= describe_first(self._env, info["observation_raw"])
        if (grasp := self._core.grasp) is not UNMOVED:
            about |= {"grasp (m, wxyz)": np.concatenate(grasp).round(9).tolist()}
        names = {
            "observed": observed_columns(self._env),
            "parts": part_columns(self._env),
        }
        with Episode(metadata=about, path=file, **names) as episode:
            while not done:
                action = self._policy(observation)
                try:
                    observation, reward, ended, cut, info = self._env.step(action)
                except ArmError as error:
                    stopped, said = error.reason or str(error), str(error)
                    break
                state = self._core.state
                blocks.append(state.log)
                film.add(state, self._core.fixture, self._core.believed)
                raw = info["observation_raw"]
                done_for = self._core.done_for(action)
                about_step = steps, done_for, float(reward), raw
                episode.append(state.log, *about_step, parts=state.parts)
                steps += 1
                violations += int(info["limit_violations"])
                if int(state.flags) & FLAG_MASK["ended"]:
                    stopped, said = "last_line", _LAST_LINE
                done = ended or cut or bool(stopped)
            episode.metadata[SUCCESS] = bool(info["success"]) and not stopped
        film_error = self._show(film, job)
        log = "" if file is None else file.name
        outcome = replace(
            _outcome(job, blocks, fixture, steps, violations, info),
            stop=ArmStop(reason=stopped, text=said),
            conditions=Conditions(tare=tuple(tare), perturbation=perturbation),
            files=TryFiles(log=log, film_error=film_error),
        )
        return replace(outcome, success=False) if stopped else outcome

    def _not_begun(
        self, job: TrialJob, fixture: Pose, error: ArmError | StartError
    ) -> Outcome:
        """Return a missed try whose start cannot be; raise what ends all tries."""
        violations, reason = 0, "start"
        if isinstance(error, ArmError):
            reason = error.reason
            if reason not in _BEFORE:
                raise error
            if isinstance(error.state, ArmState):
                violations = self._core.violations.count(error.state.log)
        nothing = {"success": False, "depth": math.nan}
        outcome = _outcome(job, [], fixture, 0, violations, nothing)
        return replace(outcome, stop=ArmStop(reason=reason, text=str(error)))

    def _show(self, film: Film, job: TrialJob) -> str:
        """Write the film of the first try at a pose, if films are wanted.

        Returns:
            Why there is none, if it failed: the tries are worth more than a picture.
        """
        if self._films is None or job.attempt > 0:
            return ""
        name = film_name(self._poses[job.pose])
        try:
            with closing(Renderer(self._core.cell)) as renderer:
                film.write(self._films / name, renderer)
        except Exception as error:  # a driver's may be of any kind
            return f"no {name}: {error}"
        return ""

    def close(self) -> None:
        """Release the environment."""
        self._env.close()

    def _describe(self, job: TrialJob) -> dict[str, Any]:
        pose = self._poses[job.pose]
        own = {"fixture_pose": pose._asdict(), **job._asdict()}
        return own | describe_cell(self._env)

    def _log_file(self, job: TrialJob) -> Path | None:
        if self._logs is None:
            return None
        return self._logs / f"{self._poses[job.pose].name}_{job.attempt:02d}.npz"


def _outcome(
    job: TrialJob,
    blocks: list[Array],
    fixture: Pose,
    steps: int,
    violations: int,
    info: dict[str, Any],
) -> Outcome:
    log = np.vstack([np.empty((0, len(CYCLE_COLUMNS))), *blocks])
    path = _columns(log, "x", "y", "z") - fixture.position
    return Outcome(
        job=job,
        success=bool(info["success"]),
        depth=float(info["depth"]),
        course=Course(
            steps=steps,
            violations=violations,
            path=path @ matrix_from_quat(fixture.quat_wxyz),
        ),
        force=_force(blocks),
    )


def _force(blocks: list[Array]) -> ContactForce:
    """Return the contact force of a try; nan where the arm measures none.

    Args:
        blocks: The cycle log of each policy step; over a network some are shorter.
    """
    vectors = [_columns(block, "fx", "fy", "fz") for block in blocks if len(block)]
    vectors = vectors or [np.full((1, 3), math.nan)]
    force = np.linalg.norm(np.vstack(vectors), axis=1)
    in_contact = force >= CONTACT_THRESHOLD
    if np.isnan(force).any():
        return ContactForce(mean=math.nan, peak=math.nan, step=math.nan, cycles=0)
    return ContactForce(
        mean=float(force[in_contact].mean()) if in_contact.any() else 0.0,
        peak=float(force.max()),
        step=max(float(np.linalg.norm(v.mean(axis=0))) for v in vectors),
        cycles=int(in_contact.sum()),
    )


def _columns(log: Array, *names: str) -> Array:
    return log[:, [COLUMN[name] for name in names]]


def run_trials(
    make_env: Callable[[], gym.Env],
    load_policy: Callable[[], Actor],
    jobs: Sequence[TrialJob],
    *,
    poses: Sequence[FixturePose],
    logs: Path | None = None,
    films: Path | None = None,
    workers: int = 1,
) -> Generator[Outcome]:
    """Run every job and yield the outcomes as they come, in order.

    The outcome of a job depends on its seed alone, not on the number of workers.

    Args:
        make_env: Builds an environment; each worker builds one. With more than one
            worker it must be picklable.
        load_policy: Loads the policy, under the same condition.
        jobs: The tries.
        poses: Poses of the fixture that the jobs refer to by index.
        logs: Existing folder for the Episode logs, or None to keep none.
        films: Existing folder for a film of each pose's first try, or None for none.
        workers: Number of processes, at least 1; 1 stays in this one.
    """
    if workers == 1:
        trialist = TrialRunner(make_env, load_policy, poses, logs, films)
        try:
            yield from map(trialist.run, jobs)
        finally:
            trialist.close()
        return
    with ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_worker,
        initargs=(make_env, load_policy, poses, logs, films),
    ) as pool:
        yield from pool.map(_run_in_worker, jobs)


_of_this_process: list[TrialRunner] = []


def _start_worker(*settings: Any) -> None:
    warnings.simplefilter("ignore", UnprovenWarning)  # the parent process has warned
    _of_this_process.append(TrialRunner(*settings))


def _run_in_worker(job: TrialJob) -> Outcome:
    return _of_this_process[0].run(job)
