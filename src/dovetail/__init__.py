"""Train contact-rich manipulation in simulation, transfer it to a robot, inside limits.

Importing the package registers the Gymnasium environments by name only; nothing heavy
is loaded before one of them is made.
"""

from importlib.metadata import version

import gymnasium

__version__ = version("dovetail")
"""Version of the installed package; its one home is pyproject.toml."""

gymnasium.register(
    id="dovetail/PegInHole-v0",
    entry_point="dovetail.envs.peg_in_hole:PegInHoleEnv",
)
gymnasium.register(
    id="dovetail/RailClip-v0",
    entry_point="dovetail.envs.rail_clip:RailClipEnv",
)
