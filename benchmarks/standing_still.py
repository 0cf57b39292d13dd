"""How far does an arm drift that is asked for nothing, in free air?

    python benchmarks/standing_still.py --minutes 10 --random 10

After a tare every action is zero. Prints, for each twin and period, the largest drift
of a joint and of the tool, from half a second after the tare on. `--random N` adds N
twins drawn inside the declared range: as `hard`, with masses +-20 %, a gravity residual
of +-1 m/s2 per axis, 0 to 3 times its friction and damping, and 0 to 10 ms of delay.
"""

import argparse
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np

import dovetail  # noqa: F401  (registers the environments)
from dovetail.control.period import PERIODS, POLICY_PERIOD
from dovetail.control.proven import DECLARED, GRAVITY_ERROR
from dovetail.plants.twin import Twin, list_twins, load_twin
from dovetail.robots.find import DEFAULT_ROBOT

SETTLE_STEPS = 10


def random_twin(seed: int) -> Twin:
    """Draw a twin inside the declared range."""
    rng = np.random.default_rng(seed)
    base = load_twin("hard")
    spread, late = DECLARED["mass_error"], DECLARED["delay"]
    return replace(
        base,
        mass_scale=tuple(1.0 + rng.uniform(-spread, spread, 7)),
        gravity_residual=tuple(rng.uniform(-GRAVITY_ERROR, GRAVITY_ERROR, 3)),
        coulomb=tuple(rng.uniform(0.0, 3.0) * np.array(base.coulomb)),
        damping=tuple(rng.uniform(0.0, 3.0) * np.array(base.damping)),
        command_delay=float(rng.uniform(0.0, late)),
    )


def drift(
    twin: Twin | str, robot: str, period: float, minutes: float
) -> tuple[float, float]:
    """Return the largest drift of a joint [rad] and of the tool [m]."""
    options: dict[str, Any] = {} if twin == "none" else {"twin": twin}
    made = gym.make(
        "dovetail/PegInHole-v0", tare=True, robot=robot, period=period, **options
    )
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
    parser.add_argument("--robot", default=DEFAULT_ROBOT)
    parser.add_argument("--random", type=int, default=0, help="twins drawn at random")
    args = parser.parse_args()
    drawn = {f"random {seed}": random_twin(seed) for seed in range(args.random)}
    for name, twin in ({name: name for name in args.twin} | drawn).items():
        for period in PERIODS:
            joint, tool = drift(twin, args.robot, period, args.minutes)
            print(
                f"{name:9s} {1e3 * period:3g} ms: joint {joint:.4f} rad, "
                f"tool {1e3 * tool:.2f} mm in {args.minutes:g} min",
                flush=True,
            )


if __name__ == "__main__":
    main()
