"""A window beside our pictures: `render_mode="human"`, with a screen and without."""

import os
import shutil
import subprocess
import sys

import pytest

from dovetail.errors import MissingDependencyError
from dovetail.view.gl_context import find_backend
from extras import need

try:
    needed = [] if find_backend() == "egl" else ["MUJOCO_GL=egl"]
except MissingDependencyError:
    needed = ["EGL (Debian: apt install libegl1 libgl1-mesa-dri)"]
pytestmark = pytest.mark.skipif(bool(needed), reason=f"needs {' '.join(needed)}")

SHOW = """
import dovetail
import gymnasium

beside = gymnasium.make("dovetail/PegInHole-v0", render_mode="rgb_array")
beside.reset(seed=0)
before = beside.render()
for _ in range(2):
    env = gymnasium.make("dovetail/PegInHole-v0", render_mode="human")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()
assert (beside.render() == before).all()
beside.close()
"""
NO_CONTEXT_LEFT = """
import dovetail
import gymnasium

env = gymnasium.make("dovetail/PegInHole-v0", render_mode="rgb_array")
env.reset(seed=0)
env.render()
from OpenGL import EGL  # by the platform that MuJoCo has chosen

assert not EGL.eglGetCurrentContext()
env.close()
"""
ENDED_BY_OTHERS = """
import dovetail
import gymnasium
import mujoco.egl
from OpenGL import EGL

def drawn():
    env = gymnasium.make("dovetail/PegInHole-v0", render_mode="rgb_array")
    env.reset(seed=0)
    return env, env.render()

env, before = drawn()
EGL.eglTerminate(mujoco.egl.EGL_DISPLAY)
assert (env.render() == before).all()
env.close()
env, again = drawn()
assert (again == before).all()
env.close()
"""


def play(program, *before, **variables):
    """Run a program in a process of its own; return what it said of itself."""
    own = {n: v for n, v in os.environ.items() if n not in ("DISPLAY", "MUJOCO_GL")}
    done = subprocess.run(
        [*before, sys.executable, "-W", "ignore", "-c", program],
        env=own | variables,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize("program", [NO_CONTEXT_LEFT, ENDED_BY_OTHERS])
def test_pictures_share_the_process_with_what_else_draws(program):
    code, said = play(program)
    assert code == 0, said
    assert "Exception ignored" not in said


def test_a_window_is_shown_on_an_x_display():
    need("pygame")
    if shutil.which("xvfb-run") is None:
        pytest.skip("needs Xvfb (Debian: apt install xvfb xauth)")
    code, said = play(SHOW, "xvfb-run", "-a")
    assert code == 0, said
    assert "Exception ignored" not in said


def test_a_window_without_a_display_closes():
    need("pygame")
    code, said = play(SHOW)
    assert code == 0, said
    assert "Exception ignored" not in said
