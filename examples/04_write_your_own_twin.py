"""Write a twin file, and see what one imperfection does to the arm.

A twin file names every imperfection: `dovetail twin show medium` prints one to start
from. Here the gravity compensation of the shipped easy twin is made worse; nothing
tells the controller, so the arm drifts until its damping balances the error.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np

from dovetail import load_twin


def drift(steps: int, **options: str) -> np.ndarray:
    """Return how far the tool moves [mm] under an action of zeros."""
    env = gym.make("dovetail/PegInHole-v0", tare=False, **options)  # let it drift
    _, first = env.reset(seed=3)
    info = first
    for _ in range(steps):
        info = env.step(np.zeros(4, dtype=np.float32))[-1]
    env.close()
    return 1e3 * (info["position_error"] - first["position_error"])


def main() -> None:
    """Write the file, load it again, and compare the drift."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a quarter of a second")
    args = parser.parse_args()
    steps = 5 if args.quick else 20

    heavy = replace(
        load_twin("easy"),
        description="as easy, but gravity compensated 5 % short",
        gravity_residual=(0.0, 0.0, -0.5),
    )
    file = Path(tempfile.mkdtemp()) / "heavy.toml"
    file.write_text(heavy.to_toml(), encoding="utf-8")
    print(f"written: {file}")

    for name, options in (
        ("ideal plant", {"plant": "mujoco"}),
        ("twin easy", {"twin": "easy"}),
        ("twin heavy", {"twin": str(file)}),
    ):
        x, y, z = drift(steps, **options)
        print(f"{name:12} drifts {x:+7.2f} {y:+7.2f} {z:+7.2f} mm in {steps / 20:g} s")


if __name__ == "__main__":
    main()
