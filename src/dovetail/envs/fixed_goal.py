"""The hole at one place in every episode, as on a table where nobody moves it."""

from typing import Any

import gymnasium

from dovetail.envs.workspace import require_inside
from dovetail.poses import Pose


class FixedGoal(gymnasium.Wrapper):
    """Starts every episode with the hole at a given pose; starts stay random."""

    def __init__(self, env: gymnasium.Env, hole: Pose) -> None:
        """Take the environment and the pose of the hole's mouth.

        Raises:
            ConfigError: The hole lies outside the arm's workspace.
        """
        super().__init__(env)
        core: Any = env.unwrapped
        require_inside(core.scene, core.arm, core.walls(), hole)
        self.hole = hole

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; `options` may still name another hole."""
        return self.env.reset(seed=seed, options={"hole": self.hole} | (options or {}))
