"""The environments that have a name, and what a name stands for."""

import gymnasium
from gymnasium.envs.registration import load_env_creator

from dovetail.envs.peg_in_hole import PegInHoleEnv
from dovetail.errors import ConfigError


def environment_class(env_id: str) -> type[PegInHoleEnv]:
    """Return the class behind a Gymnasium id.

    Raises:
        ConfigError: No environment of dovetail; lists them.
    """
    spec = gymnasium.registry.get(env_id)
    found = spec.entry_point if spec else None
    if isinstance(found, str):
        found = load_env_creator(found)
    if not (isinstance(found, type) and issubclass(found, PegInHoleEnv)):
        known = ", ".join(name for name in gymnasium.registry if "dovetail/" in name)
        raise ConfigError(f"environment {env_id!r} is unknown; known: {known}")
    return found
