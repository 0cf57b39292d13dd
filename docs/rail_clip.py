"""Draw docs/rail-clip.png: the shipped policy hooks a component over a rail's lip."""

import sys
from pathlib import Path

import numpy as np
from parts import SIDE, looking_at
from PIL import Image

from dovetail.envs.unwrapped import require_contact_env
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.policy_env import make_policy_env
from dovetail.view.renderer import CameraView, Renderer

ROOT = Path(__file__).parent.parent
SEED = 1
SHARES = 0.0, 0.35, 0.7, 1.0
"""Of the way from the first contact to the end, at which a picture is drawn."""


def main(file: Path) -> None:
    """Play a try, and draw it from above."""
    policy = Policy.load(find_policy("rail_clip"))
    env = make_policy_env(policy)
    core = require_contact_env(env)
    seen, info = env.reset(seed=SEED)
    states, ended = [], False
    while not ended:
        seen, _, ended, _, info = env.step(policy(seen))
        if states or info["contact_force_max"] > 0.0:
            states.append(core.state)
    renderer = Renderer(core.cell, width=SIDE, height=SIDE, samples=4)
    middle = core.fixture.position - np.array([0.02, 0.0, 0.0])
    camera = looking_at(middle, np.array([-0.02, 0.001, 0.26]))
    view = CameraView(camera, (-0.14, 0.14, -0.14, 0.14))
    pictures = []
    for share in SHARES:
        state = states[round(share * (len(states) - 1))]
        drawn = renderer.draw(state.q, core.fixture, view=view, parts=state.parts)
        pictures.append(drawn)
    renderer.close()
    env.close()
    Image.fromarray(np.hstack(pictures)).save(file)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else ROOT / "docs" / "rail-clip.png")
