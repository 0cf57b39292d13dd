"""Make the environment, hold still for two seconds, and print what the robot knows.

An action of zeros asks for no acceleration: the controller damps the arm, holds it
upright and turns it like the hole. Change plant to "bullet" for the other engine, or
write twin="medium" in its place.
"""

import argparse

import gymnasium as gym
import numpy as np

import dovetail  # noqa: F401  (registers the environments)


def main() -> None:
    """Hold, and print depth and force."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plant", default="mujoco", help="mujoco or bullet")
    parser.add_argument("--quick", action="store_true", help="ten steps only")
    args = parser.parse_args()

    env = gym.make("dovetail/PegInHole-v0", plant=args.plant, peg="square")
    _, info = env.reset(seed=0)
    print(f"at the start  depth {1e3 * info['depth']:7.2f} mm")
    for step in range(10 if args.quick else 40):
        _, reward, _, _, info = env.step(np.zeros(4, dtype=np.float32))
        if step % 5 == 4:
            print(
                f"step {step + 1:3}      depth {1e3 * info['depth']:7.2f} mm, "
                f"theta {info['theta_error']:+.4f} rad, reward {float(reward):+.3f}"
            )
    env.close()


if __name__ == "__main__":
    main()
