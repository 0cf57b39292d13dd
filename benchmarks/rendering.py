"""How many pictures of 640 x 480 an environment renders per second.

    python benchmarks/rendering.py --frames 300

In turns with as many of MuJoCo's own `Renderer` of the same model, seen from the same
place, with one sample per pixel and no reflections as well. That draws neither path nor
arrows nor the believed fixture. Prints rates by the wall's clock and by the processor
time of all threads, which other work disturbs less, their ratio, and what draws.
"""

import argparse
import os
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

import dovetail  # noqa: F401  (registers the environments)
from dovetail.mujoco_gl import LIBRARIES
from dovetail.view.cell_model import cell_spec
from dovetail.view.gl_context import find_backend

WIDTH, HEIGHT = 640, 480
TURNS = 5
AZIMUTH, ELEVATION, DISTANCE = 142.0, -16.0, 1.25  # degrees, degrees, m
LOOK_AT = (0.42, 0.0, 0.33)  # m; as the environment's pictures


def rendered(env: Any) -> Callable[[], np.ndarray]:
    """Return what draws an environment, which is reset."""
    env.reset(seed=0)

    def draw() -> np.ndarray:
        return np.asarray(env.render())

    return draw


def bare(env: Any) -> Callable[[], np.ndarray]:
    """Return what draws the same cell by MuJoCo alone."""
    import mujoco

    core = env.unwrapped
    spec = cell_spec(core.cell)
    spec.visual.quality.offsamples = 0
    model: Any = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = core.state.q
    data.mocap_pos[0], data.mocap_quat[0] = core.fixture
    mujoco.mj_forward(model, data)
    renderer = mujoco.Renderer(model, HEIGHT, WIDTH)
    renderer.scene.flags[int(mujoco.mjtRndFlag.mjRND_REFLECTION)] = 0
    camera = mujoco.MjvCamera()
    camera.lookat[:] = LOOK_AT
    camera.azimuth, camera.elevation = AZIMUTH, ELEVATION
    camera.distance = DISTANCE

    def draw() -> np.ndarray:
        renderer.update_scene(data, camera)
        return renderer.render()

    return draw


def rates(draw: Callable[[], np.ndarray], frames: int) -> tuple[float, float]:
    """Return pictures per second of wall time, and of processor time."""
    wall, busy = time.perf_counter(), time.process_time()
    for _ in range(frames):
        draw()
    wall, busy = time.perf_counter() - wall, time.process_time() - busy
    return frames / wall, frames / busy


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--frames", type=int, default=300, help="of each, in 5 turns")
    args = parser.parse_args()
    os.environ["MUJOCO_GL"] = find_backend()  # before MuJoCo is loaded: it asks once
    env = gym.make("dovetail/PegInHole-v0", render_mode="rgb_array")
    ways = {"env.render()": rendered(env), "mujoco.Renderer": bare(env)}
    shapes = {name: draw().shape for name, draw in ways.items()}
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
    for _ in range(TURNS):
        for name, draw in ways.items():
            found[name].append(rates(draw, max(1, args.frames // TURNS)))
    for name, turns in found.items():
        height, width, _ = shapes[name]
        wall, busy = np.median(turns, axis=0)
        print(
            f"{name:15s} {width} x {height}: {wall:6.1f} pictures per second, "
            f"{min(turns)[0]:.1f} to {max(turns)[0]:.1f}; {busy:.1f} per second of "
            "processor time"
        )
    own, other = (np.median(turns, axis=0) for turns in found.values())
    wall, busy = own / other
    print(
        f"ratio {wall:.2f}, of processor time {busy:.2f}, drawn by "
        f"{LIBRARIES[find_backend()]}"
    )
    env.close()


if __name__ == "__main__":
    main()
