"""The fixture at one place in every episode, as on a table where it never moves."""

from typing import Any

import gymnasium

from dovetail.envs.unwrapped import require_contact_env
from dovetail.envs.workspace import require_inside
from dovetail.poses import Pose


class FixedFixture(gymnasium.Wrapper):
    """Starts every episode with the fixture at a given pose; starts stay random."""

    def __init__(self, env: gymnasium.Env, fixture: Pose) -> None:
        """Take the environment and the fixture's pose.

        Raises:
            ConfigError: The fixture lies outside the arm's workspace.
        """
        super().__init__(env)
        core = require_contact_env(env)
        require_inside(core.task, core.cell, core.arm, fixture)
        self.fixture = fixture

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; `options` may still name another place."""
        return self.env.reset(
            seed=seed, options={"fixture": self.fixture} | (options or {})
        )
