"""How far one action travels: the calls and files of dovetail's Python that it enters.

One `step` of a running environment is traced, from the action to the torque's cycles in
C++ and back to the observation. Prints each call, indented by its depth (calls of
Gymnasium between them count as depth only), then how many calls and files there were.

    python benchmarks/hops.py
"""

import argparse
import sys
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import dovetail

ROOT = Path(dovetail.__file__).parent


class Call(NamedTuple):
    """One call of a function of dovetail's."""

    depth: int
    file: str
    name: str


def trace_step(env: gym.Env, action: np.ndarray) -> list[Call]:
    """Return the calls of one step, in their order."""
    calls: list[Call] = []
    depth = 0

    def note(frame: FrameType, event: str, _: Any) -> None:
        nonlocal depth
        depth += {"call": 1, "return": -1}.get(event, 0)
        file = Path(frame.f_code.co_filename)
        if event == "call" and file.is_relative_to(ROOT):
            name = frame.f_code.co_qualname
            calls.append(Call(depth, str(file.relative_to(ROOT)), name))

    sys.setprofile(note)
    try:
        env.step(action)
    finally:
        sys.setprofile(None)
    return calls


def trace(env_id: str, warm: int = 20) -> list[Call]:
    """Return the calls of a step in an episode that runs.

    Args:
        env_id: Name of the environment.
        warm: Steps before the one that is traced.
    """
    env = gym.make(env_id)
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (warm + 1, 4))
    *before, last = actions.astype(np.float32)
    for action in before:
        env.step(action)
    calls = trace_step(env, last)
    env.close()
    return calls


def main() -> None:
    """Trace and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env", default="dovetail/PegInHole-v0", help="which one")
    calls = trace(parser.parse_args().env)
    for call in calls:
        print(f"{'  ' * call.depth}{call.name}  {call.file}")
    print(f"{len(calls)} calls in {len({call.file for call in calls})} files")


if __name__ == "__main__":
    main()
