"""What needs no learning: how far blind actions get in each task.

A task that a constant action does is no task. For each environment:

* constant: the best of all actions whose components are -1, -0.5, 0, 0.5 or 1 (a subset
  is drawn where there are more than `--most`). Each plays a few tries; the best third
  plays as many again, until one is left, which plays `--tries` new ones.
* straight: told the true pose, go over the goal by a proportional law, then push along
  the axis.
* search: the scripted search of `dovetail.search.corner`, told the true pose, where the
  task's axes let the part be tilted.

Prints successes of `--tries`, each on seeds that chose nothing.

    python benchmarks/blind_baselines.py dovetail/PegInHole-v0 dovetail/GearMesh-v0
    python benchmarks/blind_baselines.py dovetail/PegInHole-v0 --set peg=round
"""

import argparse
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import dovetail  # noqa: F401  (registers the environments)
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.registered import make
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.search.corner import SEARCH_AXES, CornerSearch
from dovetail.types import Array

LEVELS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Components of the constant actions."""
FIRST = 4
"""Tries of each of them in the first round."""
CHOOSING, COUNTING = 1_000, 50_000
"""First seeds of the tries that choose an action, and of those that count."""
GAIN = 20.0
"""Action per metre beside the goal's axis [1/m]."""
PUSH = 0.5
"""Action along the axis, towards the goal."""
Acts = Callable[[NDArray[np.float32], dict[str, Any]], ArrayLike]


def count(env: Any, acts: Callable[[], Acts], seeds: Sequence[int]) -> int:
    """Return how many tries succeed."""
    done = 0
    for seed in seeds:
        observation, info = env.reset(seed=seed)
        act, ended, cut = acts(), False, False
        while not (ended or cut):
            action = np.asarray(act(observation, info), dtype=np.float32)
            observation, _, ended, cut, info = env.step(action)
        done += bool(info["success"])
    return done


def constant(env: Any, most: int, tries: int, rng: np.random.Generator) -> str:
    """Return the successes of the best constant action, with the action."""
    size = env.action_space.shape[0]
    every = list(itertools.product(LEVELS, repeat=size))
    if len(every) > most:
        every = [every[i] for i in rng.choice(len(every), most, replace=False)]
    scores = dict.fromkeys(every, 0)
    played = 0
    while len(scores) > 1:
        seeds = range(CHOOSING + played, CHOOSING + played + FIRST)
        played += FIRST
        for action in scores:
            scores[action] += count(env, lambda a=action: lambda *_: a, seeds)
        kept = sorted(scores, key=lambda action: -scores[action])
        scores = {action: scores[action] for action in kept[: max(1, len(kept) // 3)]}
    (action,) = scores
    seeds = range(COUNTING, COUNTING + tries)
    return f"{count(env, lambda: lambda *_: action, seeds)}/{tries} {list(action)}"


def straight(core: ContactEnv) -> Acts:
    """Return the law that goes over the goal, and then pushes."""
    linear = [i for i, name in enumerate(core.commands.axes) if name in "XYZ"]
    which = ["XYZ".index(core.commands.axes[i]) for i in linear]

    def act(observation: NDArray[np.float32], info: dict[str, Any]) -> Array:
        goal = core.task.goal(core.believed)
        error = np.asarray(info["position_error"])
        height = float(error @ goal.normal)
        beside = error - height * goal.normal
        depth = goal.surface - float(goal.normal @ goal.position)
        is_over = np.linalg.norm(beside) < 0.001 or height > depth + 0.01
        push = (-PUSH if is_over else PUSH) * goal.normal
        action = np.zeros(len(core.commands.axes))
        action[linear] = (push - GAIN * beside).clip(-1.0, 1.0)[which]
        return action

    return act


def searching(core: ContactEnv) -> Acts:
    """Return the scripted search, which begins anew."""
    search = CornerSearch(core)
    return lambda observation, info: search(observation)


def main() -> None:
    """Play every baseline in every environment."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("env", nargs="+", help="Gymnasium ids")
    parser.add_argument("--set", nargs="*", default=[], help="settings, NAME=VALUE")
    parser.add_argument("--most", type=int, default=200, help="constant actions")
    parser.add_argument("--tries", type=int, default=60)
    given = parser.parse_args()
    settings = dict(text.split("=", 1) for text in given.set)
    rng = np.random.default_rng(0)
    seeds = range(COUNTING, COUNTING + given.tries)
    for name in given.env:
        env = make(name, **settings)
        core = require_contact_env(env)
        print(f"{name} {settings or ''}".rstrip(), flush=True)
        blind = constant(env, given.most, given.tries, rng)
        print(f"  best constant action: {blind}", flush=True)
        pushed = count(env, lambda core=core: straight(core), seeds)
        print(f"  straight push, told the truth: {pushed}/{given.tries}", flush=True)
        env.close()
        try:
            tilting = make(name, task=SEARCH_AXES, theta_range=0.3, **settings)
            core = require_contact_env(tilting)
            found = count(tilting, lambda core=core: searching(core), seeds)
            print(f"  scripted search: {found}/{given.tries}", flush=True)
        except ConfigError as error:
            print(f"  scripted search: no, {error}", flush=True)


if __name__ == "__main__":
    main()
