"""The environment of a task under its wrappers."""

import gymnasium

from dovetail.envs.contact_env import ContactEnv
from dovetail.errors import ConfigError


def require_contact_env(env: gymnasium.Env) -> ContactEnv:
    """Return the `ContactEnv` under an environment's wrappers.

    Args:
        env: An environment, wrapped or not.

    Raises:
        ConfigError: It is another environment; says which.
    """
    core = env.unwrapped
    if not isinstance(core, ContactEnv):
        kind = type(core)
        raise ConfigError(
            f"the environment is a {kind.__module__}.{kind.__qualname__}, which has no "
            "task and no arm; give one of dovetail's, or register your own with "
            "dovetail.envs.registered.register_task"
        )
    return core
