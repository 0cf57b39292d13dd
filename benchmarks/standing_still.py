"""How far does an arm drift that is asked for nothing, in free air?

    python benchmarks/standing_still.py --minutes 10

After a tare every action is zero. Prints, for each twin and period, the largest drift
of a joint and of the tool, from half a second after the tare on.
"""

import argparse
from typing import Any

import gymnasium as gym
import numpy as np

import dovetail  # noqa: F401  (registers the environments)
from dovetail.control.period import PERIODS, POLICY_PERIOD
from dovetail.plants.twin import list_twins

SETTLE_STEPS = 10


def drift(twin: str, period: float, minutes: float) -> tuple[float, float]:
    """Return the largest drift of a joint [rad] and of the tool [m]."""
    options: dict[str, Any] = {} if twin == "none" else {"twin": twin}
    made = gym.make("dovetail/PegInHole-v0", tare=True, period=period, **options)
    env: Any = made.unwrapped
    env.reset(seed=3)
    nothing = np.zeros(env.action_space.shape, dtype=np.float32)
    for _ in range(SETTLE_STEPS):
        env.step(nothing)
    q, x = env.state.q.copy(), env.state.tool.position.copy()
    joint = tool = 0.0
    for _ in range(round(60.0 * minutes / POLICY_PERIOD)):
        env.step(nothing)
        state = env.state
        joint = max(joint, float(np.abs(state.q - q).max()))
        tool = max(tool, float(np.linalg.norm(state.tool.position - x)))
    made.close()
    return joint, tool


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--twin", nargs="+", default=["none", *list_twins()])
    args = parser.parse_args()
    for twin in args.twin:
        for period in PERIODS:
            joint, tool = drift(twin, period, args.minutes)
            print(
                f"{twin:8s} {1e3 * period:3g} ms: joint {joint:.4f} rad, "
                f"tool {1e3 * tool:.2f} mm in {args.minutes:g} min",
                flush=True,
            )


if __name__ == "__main__":
    main()
