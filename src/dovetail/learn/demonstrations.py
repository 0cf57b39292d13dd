"""Episode logs of any actor, as transitions to learn from, and pretraining on them.

A log has what was observed unscaled, by columns; it is scaled here as the run's own
environment does it, so that stacks and recalled places may differ from the recording's.

Reference:
    Ball et al. 2023, Efficient online reinforcement learning with offline data,
    section 4.2: layer normalisation bounds what a critic extrapolates.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.history_features import HistoryFeatures
from dovetail.envs.log_facts import ACTION, CELL, describe_cell, observed_columns
from dovetail.envs.stacking import History
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import LogError
from dovetail.learn.config import TrainConfig
from dovetail.learn.recorded_steps import MEANT, RecordedSteps, find_logs, read_steps

_USUAL = "record it for this task, or train with that"
_ADVICE = {
    "axes": "record or train with the same --task",
    "scale": "give f_scale, f_scale_angular, theta_range and position_range as there",
    "force_damping": "give --force-damping as there",
    "script": "its actions correct a script's; leave the log out",
    "force_weight": "its rewards are others; train with --force-weight as there",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Transitions:
    """Steps of several episodes, one after the other."""

    observations: NDArray[np.float32]
    """Before each step, as the policy sees it, shape (steps, observation)."""
    next_observations: NDArray[np.float32]
    """After it."""
    actions: NDArray[np.float32]
    """That was taken, shape (steps, action)."""
    rewards: NDArray[np.float32]
    """Unscaled, shape (steps,)."""
    is_last: NDArray[np.bool_]
    """True where the episode's log ends with the step."""
    is_success: NDArray[np.bool_]
    """True where the step completed the task; any other last step is a time-out."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.rewards)


def load_demonstrations(paths: Sequence[str], env: Any) -> Transitions:
    """Read logs as the transitions of an environment.

    Args:
        paths: Episode logs, or folders of them.
        env: Environment that is trained in, wrapped or not.

    Raises:
        LogError: A log is damaged, empty, of another task, robot, action or step
            length, or lacks a column that the policy sees; names the file, and says
            what to do.
    """
    core = require_contact_env(env)
    parts = [_as_seen_by(core, path, read_steps(path)) for path in find_logs(paths)]
    names = [f.name for f in fields(Transitions)]
    joined = {name: [vars(part)[name] for part in parts] for name in names}
    return Transitions(**{name: np.concatenate(joined[name]) for name in names})


def _as_seen_by(core: ContactEnv, path: Path, steps: RecordedSteps) -> Transitions:
    """Return one log's transitions in an environment that it fits.

    Raises:
        LogError: It does not fit.
    """
    _require_same(path, steps, core)
    names = observed_columns(core)
    if missing := [name for name in names if name not in steps.columns]:
        raise LogError(
            f"the log {path} has no column {missing[0]}, which this policy sees: "
            "record it in the environment that is trained in (the same "
            "--also and --without), or leave the log out"
        )
    scaling, config = core.scaling, core.config
    size = len(core.commands)
    recall = HistoryFeatures(config.recall, scaling, size)
    history = History(config.stack, len(core.columns), size)
    raw = steps.seen[:, [steps.columns.index(name) for name in names]]
    seen = [history.reset(recall.reset(scaling.scale(raw[0])))]
    for action, numbers in zip(steps.actions, raw[1:], strict=True):
        seen.append(history.push(action, recall.push(action, scaling.scale(numbers))))
    rows = np.array(seen, dtype=np.float32)
    is_last = np.zeros(len(steps), dtype=bool)
    is_last[-1] = True
    return Transitions(
        observations=rows[:-1],
        next_observations=rows[1:],
        actions=steps.actions,
        rewards=steps.rewards,
        is_last=is_last,
        is_success=is_last & steps.success,
    )


def _require_same(path: Path, steps: RecordedSteps, core: ContactEnv) -> None:
    """Refuse a log of another task or robot, or whose actions meant something else."""
    here = describe_cell(core)
    own = here[CELL]
    pairs = [(name, steps.cell.get(name), own[name]) for name in ("env_id", "robot")]
    task = steps.cell.get("task")
    usual = {f.name: f.default for f in fields(core.task)}  # where a log is older
    for name, value in own["task"].items():
        # A gap may be another one: a wider one is where one begins to demonstrate.
        if isinstance(value, str) and name != "axes" and isinstance(task, Mapping):
            pairs.append((name, task.get(name, usual[name]), value))
    theirs, ours = steps.cell.get("cell") or {}, own.get("cell") or {}
    pairs += [("cell", theirs, ours)] if theirs != ours else []
    pairs += [(name, steps.action.get(name), here[ACTION][name]) for name in MEANT]
    for name, theirs, ours in pairs:
        if not _is_same(theirs, ours):
            raise LogError(
                f"the log {path} was taken with {name.removesuffix('_id')} "
                f"{str(theirs)[:80]}, this run has {ours}: {_ADVICE.get(name, _USUAL)}"
            )


def _is_same(theirs: Any, ours: Any) -> bool:
    if isinstance(ours, str) or (isinstance(ours, list) and isinstance(ours[0], str)):
        return theirs == ours
    try:
        numbers = np.array(theirs, dtype=float)
    except (TypeError, ValueError):
        return False
    wanted = np.array(ours, dtype=float)
    return numbers.shape == wanted.shape and bool(np.allclose(numbers, wanted))


def rows_of(count: int, num_envs: int) -> int:
    """Return how many rows of a replay buffer so many transitions fill."""
    return -(-count // num_envs)


def fill(buffer: Any, transitions: Transitions, reward_scale: float) -> None:
    """Put transitions into the first rows of an empty replay buffer.

    Each environment's column gets a share of them, one after the other; the last
    column is filled up with the first ones again.

    Args:
        buffer: A replay buffer of Stable-Baselines3.
        transitions: To put in.
        reward_scale: Factor on the rewards inside training.
    """
    rows = rows_of(len(transitions), buffer.n_envs)
    places = np.arange(rows * buffer.n_envs) % len(transitions)
    places = places.reshape(buffer.n_envs, rows).T
    is_last = transitions.is_last[places]
    is_last[-1] = True  # what comes next in this column is another's
    is_cut = is_last & ~transitions.is_success[places]
    buffer.observations[:rows] = transitions.observations[places]
    buffer.next_observations[:rows] = transitions.next_observations[places]
    buffer.actions[:rows] = transitions.actions[places]
    buffer.rewards[:rows] = reward_scale * transitions.rewards[places]
    buffer.dones[:rows] = is_last
    buffer.timeouts[:rows] = is_cut
    buffer.pos = rows


def pretrain(
    model: Any, config: TrainConfig, check: Callable[[], None] = lambda: None
) -> None:
    """Do a run's gradient steps that come before its first action.

    The entropy coefficient stays as it is: it weighs chance against values that no
    action of the policy's own has tried yet, and would rise, to fall for thousands of
    steps.

    Args:
        model: SBX algorithm with the demonstrations in its buffer, and a logger.
        config: Settings of the run; `pretrain` says how many, rounded up to whole
            rounds of `gradient_steps`.
        check: Called before every round; raises KeyboardInterrupt to end it.
    """
    entropy = {k: state for k, state in vars(model).items() if k == "ent_coef_state"}
    for _ in range(math.ceil(config.first_updates / config.gradient_steps)):
        check()
        model.train(config.gradient_steps, config.batch_size)
        vars(model).update(entropy)
