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
    asked on: a person's action is done as it is, and its time does not count.

    Raises:
        ConfigError: The search cannot act here; see `CornerSearch`.
    """

    def _prepare(self) -> None:
        super()._prepare()
        self._search = CornerSearch(self)
        self.begin_acting()

    def begin_acting(self) -> None:
        """Give the policy its whole time from now on."""
        self._acted = 0  # policy steps
        self._has_searched = False  # in the last step

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; see `ContactEnv.reset`."""
        self.begin_acting()
        return super().reset(seed=seed, options=options)

    @property
    def is_searching(self) -> bool:
        """True if the next step is the search's."""
        is_late = self._acted * POLICY_PERIOD >= self.config.fall_back
        return is_late and not self.is_led

    def begin_step(self, action: NDArray[np.float32]) -> _core.Target:
        """Do what a step does before its control cycles; see `ContactEnv`."""
        asked, is_searching = self.commands.usable(action), self.is_searching
        if is_searching:
            if not self._has_searched:
                self._search.reset()
            asked = self._search(asked)
        target = super().begin_step(asked)
        self._acted += not self.is_led
        self._has_searched = is_searching
        self._begun = action
        return target

    def done_for(self, action: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return what the last step did: the search's action where that acted."""
        return self._action if self._has_searched else action
