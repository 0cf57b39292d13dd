"""The corner search as an actor that is loaded before its environment is there."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail.envs.contact_env import ContactEnv
from dovetail.search.corner import SEARCH_AXES, CornerSearch

SCRIPT_SETTINGS: Mapping[str, Any] = {
    "task": SEARCH_AXES,
    "near_speed": 0.05,
    "theta_range": 0.3,
    "f_scale": 6.0,
    "force_damping": 40.0,
    "max_steps": 400,
    "script": None,
    "fall_back": 0.0,
}
"""Settings of the environment with which the script was tried."""


class CornerScript:
    """Acts as a policy does, once it was told its environment."""

    def __init__(self) -> None:
        self._search: CornerSearch | None = None

    def take(self, env: ContactEnv) -> None:
        """Act in this environment from now on.

        Raises:
            ConfigError: Its task has other axes than the search's, or no opening.
        """
        self._search = CornerSearch(env)

    def reset(self) -> None:
        """Begin anew."""
        if self._search is not None:
            self._search.reset()

    def __call__(self, observation: NDArray[np.float32], /) -> NDArray[np.float32]:
        """Return the next action."""
        if self._search is None:
            raise RuntimeError("CornerScript: call take(env) before the first action")
        return self._search(observation)
