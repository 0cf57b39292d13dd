"""franka-sim whose physics keep step with its states; for its own environment.

By its own clock, on a busy machine, 1.1 to 1.4 steps of its physics pass from one state
to the next, and no log shows it. Here exactly one does; without a client the physics
follow the clock. `--hangs KG` adds a mass at the hand that gravity compensation leaves
out. The hand can be pushed: every quarter of a second, half of the time, in a random
direction, with the force in `--shared FILE`. That file also has the arm's true states,
see `franka_shared`. Other options are those of `run-franka-sim-server`.
"""

import argparse
import os
import sys
import tempfile
import threading
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from franka_shared import Shared

# By name: the environment of the checkers has neither.
physics, server, model_files = map(
    import_module,
    ("franka_sim.mujoco_franka_sim", "franka_sim.run_server", "franky_sim"),
)
PUSH_STEPS = 250
UNREAD = 0.01  # s
last_read = 0.0
_lock = threading.Lock()
_build = physics.build_model
_apply = physics.MujocoFrankaSim._apply_control
_publish = physics.MujocoFrankaSim._read_and_publish_state


def build_with_mass(*given: Any, **named: Any) -> Any:
    """Build the model, with the mass at its hand."""
    built, prefix = _build(*given, **named)
    hand = built.body("hand").id
    mass = built.body_mass[hand]
    built.body_mass[hand] = mass + HANGS
    built.body_gravcomp[hand] = mass / (mass + HANGS)
    return built, prefix


def step_and_read(self: Any) -> Any:
    """Return the state after one more step."""
    global last_read
    with _lock:
        last_read = time.monotonic()
        self.step(1)
        return self._state_snapshot


def step_unread(self: Any) -> None:
    """Step by the clock while no client reads states, until the server ends."""
    while self.running:
        time.sleep(1e-3)
        if time.monotonic() - last_read > UNREAD:
            with _lock:
                self.step(1)


class Pushed:
    """Pushes, and notes every state."""

    def __init__(self, shared: Shared) -> None:
        """Begin without a push."""
        self.shared = shared
        self.rng = np.random.default_rng(0)
        self.steps = 0
        self.way = np.zeros(3)

    def apply(self, simulation: Any) -> None:
        """Apply the commanded torques, and the push."""
        _apply(simulation)
        if self.steps % PUSH_STEPS == 0:
            way = self.rng.normal(size=3)
            self.way = way / np.linalg.norm(way) * (self.rng.random() < 0.5)
        self.steps += 1
        hand = simulation.model.body("hand").id
        simulation.data.xfrc_applied[hand, :3] = self.shared.push * self.way

    def publish(self, simulation: Any) -> None:
        """Publish the state, and note it."""
        _publish(simulation)
        state = simulation._state_snapshot
        is_commanded = simulation.control_mode.name == "TORQUE"
        self.shared.note(state["q"], state["dq"], is_commanded=is_commanded)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--hangs", type=float, default=0.0)
    parser.add_argument("--shared", type=Path)
    args, options = parser.parse_known_args()
    HANGS = args.hangs
    sys.argv[1:] = options
    assets = Path(model_files.__path__[0]) / "assets"
    text = (assets / "fr3.xml").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "fr3.xml"
        meshes = f'meshdir="{assets / "meshes"}"'
        model.write_text(text.replace('meshdir="assets"', meshes), encoding="utf-8")
        os.environ["FR3_MJCF"] = str(model)
        vars(physics)["build_model"] = build_with_mass
        simulation = physics.MujocoFrankaSim
        simulation.get_robot_state = step_and_read
        simulation.run_simulation = step_unread
        if args.shared is not None:
            pushed = Pushed(Shared.of(args.shared))
            simulation._apply_control = lambda self: pushed.apply(self)
            simulation._read_and_publish_state = lambda self: pushed.publish(self)
        server.main()
