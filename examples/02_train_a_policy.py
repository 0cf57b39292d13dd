"""Train a policy as `dovetail train` does, and run it without the learning stack.

Needs the extra: pip install 'dovetail-robotics[learn]'. The full run takes some
minutes on two cores; --quick shows the way in seconds and learns nothing.
"""

import argparse
import tempfile
from pathlib import Path

from dovetail import Policy, TrainConfig, make_policy_env, train


def main() -> None:
    """Train, load the policy file, and try it once."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="run folder; default a temporary one")
    parser.add_argument("--quick", action="store_true", help="300 steps only")
    args = parser.parse_args()
    out = args.out or Path(tempfile.mkdtemp()) / "run"

    options = {"clearance": 0.001}
    config = TrainConfig(out=out, task_options=options, steps=20_000, eval_episodes=50)
    if args.quick:
        config = TrainConfig(
            out=out, steps=300, learning_starts=100, eval_episodes=1, max_steps=20
        )
    (result,) = train(config)
    print(f"policy: {result.policy}")
    print(f"evaluation: {result.evaluation}")

    policy = Policy.load(result.policy)
    env = make_policy_env(policy, plant="mujoco")
    observation, _ = env.reset(seed=1)
    policy.reset()
    done = False
    while not done:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        done = terminated or truncated
    print(f"one try: success {info['success']}, depth {1e3 * info['depth']:.1f} mm")
    env.close()


if __name__ == "__main__":
    main()
