"""An environment in which the corner search takes over from a policy."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail import _core
from dovetail.control.period import POLICY_PERIOD
from dovetail.envs.contact_env import ContactEnv
from dovetail.search.corner import CornerSearch


class FallBackEnv(ContactEnv):
    """Does what is asked for `fall_back` seconds, then what the corner search does.

    The search begins from where the part is then, on any arm. A person who leads is
    asked on: a person's action is done as it is.

    Raises:
        ConfigError: The search cannot act here; see `CornerSearch`.
    """

    def _prepare(self) -> None:
        super()._prepare()
        self._search = CornerSearch(self)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; see `ContactEnv.reset`."""
        self._search.reset()
        return super().reset(seed=seed, options=options)

    @property
    def is_searching(self) -> bool:
        """Whether the next step is the search's."""
        is_late = self.steps * POLICY_PERIOD >= self.config.action.fall_back
        return is_late and not self.is_led

    def begin_step(self, action: NDArray[np.float32]) -> _core.Target:
        """Do what a step does before its control cycles; see `ContactEnv`."""
        asked = self.commands.usable(action)
        if self.is_searching:
            asked = self._search(asked)
        target = super().begin_step(asked)
        self._begun = action
        return target
