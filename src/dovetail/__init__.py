"""Train contact-rich manipulation in simulation, transfer it to a robot, inside limits.

Most programs import what they need from here: `from dovetail import train`.
`__init__.pyi` lists the names, which are loaded when they are first used. Importing the
package registers the Gymnasium environments by name only; nothing heavy is loaded
before one of them is made, but where `mujoco_gl` has to load MuJoCo itself.
"""

from importlib.metadata import version

import gymnasium
import lazy_loader

from dovetail.mujoco_gl import import_without_drawing
from dovetail.tasks.shipped import EPISODE_STEPS, TASKS

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

import_without_drawing()

__version__ = version("dovetail")
"""Version of the installed package; its one home is pyproject.toml."""

for _env_id, _task in TASKS.items():
    gymnasium.register(
        id=_env_id,
        entry_point="dovetail.envs.registered:make_untimed",
        vector_entry_point="dovetail.envs.registered:make_batch",
        max_episode_steps=EPISODE_STEPS,
        kwargs={"task_class": _task},
    )
