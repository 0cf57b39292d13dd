"""Hash every cycle of seeded tries, to show that a change of names moved no number.

    python benchmarks/torque_hashes.py record FILE [random]
    python benchmarks/torque_hashes.py compare FILE [random]

Tries the shipped policy on an ideal plant and on each twin at 5 ms and 1 ms, and plays
seeded random actions in both environments; with `random` it only does the latter. A
hash covers what the arm did in every cycle of a try, so `compare` fails on a change in
the last bit; columns that only estimate are left out, and may be added.
Hashes hold on the machine and build that made them only.
"""

import hashlib
import io
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from rich.console import Console

import dovetail  # noqa: F401  (registers the environments)
from dovetail.episode import Episode
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate
from dovetail.plants.plant import CYCLE_COLUMNS

PLACES: tuple[dict[str, Any], ...] = (
    {"plant": "mujoco"},
    *({"twin": name} for name in ("easy", "medium", "hard")),
)
PERIODS = (0.005, 0.001)
RANDOM: dict[str, tuple[str, dict[str, Any]]] = {
    "peg": ("dovetail/PegInHole-v0", {"stack": 2}),
    "round peg on a twin": (
        "dovetail/PegInHole-v0",
        {"peg": "round", "twin": "medium", "tare": True},
    ),
    "clip": ("dovetail/RailClip-v0", {}),
    "paper": ("dovetail/PegInHole-v0", {"scheme": "paper", "clearance": 0.001}),
}
STEPS = 60
DONE = [i for i, name in enumerate(CYCLE_COLUMNS) if not name.startswith("wrench_")]
"""Columns that say what the arm did."""


def shipped(tries: int) -> dict[str, str]:
    """Return the hash of each logged try of the shipped policy."""
    hashes = {}
    for place in PLACES:
        for period in PERIODS:
            with tempfile.TemporaryDirectory() as folder:
                config = EvaluationConfig(
                    policy="peg_square",
                    **place,
                    period=period,
                    tries=tries,
                    seed=11,
                    out=Path(folder) / "out",
                )
                evaluate(config, Console(file=io.StringIO()))
                for file in sorted((Path(folder) / "out" / "logs").glob("*.npz")):
                    name = f"{next(iter(place.values()))} {1e3 * period:g} ms"
                    hashes[f"{name} {file.stem}"] = _hash_file(file)
    return hashes


def _hash_file(file: Path) -> str:
    rows = Episode.load(file).data
    rest = rows[:, len(CYCLE_COLUMNS) :]  # actions, reward and observation
    return hashlib.sha256(np.hstack([rows[:, DONE], rest]).tobytes()).hexdigest()[:16]


def random_actions() -> dict[str, str]:
    """Return a hash of observations, rewards and logs under seeded random actions."""
    hashes = {}
    for name, (env_id, options) in RANDOM.items():
        digest = hashlib.sha256()
        rng = np.random.default_rng(3)
        env: Any = gym.make(env_id, **options)
        observation, _ = env.reset(seed=5)
        digest.update(observation.tobytes())
        for _ in range(STEPS):
            action = rng.uniform(-1.0, 1.0, env.action_space.shape)
            observation, reward, ended, cut, _ = env.step(action.astype(np.float32))
            digest.update(observation.tobytes() + np.float64(reward).tobytes())
            digest.update(env.unwrapped.state.log[:, DONE].tobytes())
            if ended or cut:
                env.reset()
        env.close()
        hashes[f"random {name}"] = digest.hexdigest()[:16]
    return hashes


def main() -> int:
    """Record hashes, or compare with those recorded."""
    _, *words = sys.argv
    is_random = words[2:] == ["random"]
    if len(words) != 2 + is_random or words[0] not in ("record", "compare"):
        print(__doc__)
        return 2
    file = Path(sys.argv[2])
    hashes = random_actions() | ({} if is_random else shipped(tries=2))
    if sys.argv[1] == "record":
        file.write_text(json.dumps(hashes, indent=1) + "\n")
        print(f"{len(hashes)} hashes in {file}")
        return 0
    before = json.loads(file.read_text())
    differ = sorted(n for n in before | hashes if before.get(n) != hashes.get(n))
    print(f"{len(before)} recorded, {len(differ)} differ", *differ, sep="\n  ")
    return int(bool(differ))


if __name__ == "__main__":
    sys.exit(main())
