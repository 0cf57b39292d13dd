"""Differences between the episodes of a training that the policy does not know."""

from functools import cached_property
from itertools import product
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from dovetail.errors import ConfigError
from dovetail.learn.policy_env_config import PolicyEnvConfig
from dovetail.settings import Range, settings
from dovetail.tasks.options import parse_values
from dovetail.tasks.task import Task
from dovetail.trackers.find import DEFAULT_TRACKER


@settings()
class VariationConfig(PolicyEnvConfig):
    """Differences between episodes."""

    vary: str | None = None
    """Option of the task and a value for each environment in turn, NAME=A,B.
    Of several, NAME=A,B&NAME=C,D, every pair in turn. Of parts, part=FOLDER is every
    part in a folder. The policy's file names the values that the task has."""
    doubt: Annotated[float, Range(0.0, 0.05, "m")] = 0.0
    """Largest distance of the fixture from where it is believed [m]. It is
    drawn for each episode. Reward and success use the true place, the policy cannot.
    A search tilts the part, so that the task must let it: see the recipe search."""
    doubt_turn: Annotated[float, Range(0.0, 0.5, "rad")] = 0.0
    """Largest turn of the fixture from what is believed [rad].
    It is about the vertical; a doubt must be given, too."""
    informed: bool = False
    """Tell the critics where the fixture truly is, and which values it has.
    The actor does not see them, so the policy runs as any other; for sac."""

    def kinds(self, num_envs: int) -> NDArray[np.float32]:
        """Return which values each environment has, a one among zeros in each row."""
        count = len(self._varied)
        kinds = np.eye(count, dtype=np.float32)[np.arange(num_envs) % count]
        return kinds if count > 1 else kinds[:, :0]

    def require_possible(self, num_envs: int) -> None:
        """Refuse a doubt beside a tracker, a turn without one, and too many values.

        Raises:
            ConfigError: Says what to give.
        """
        if self.doubt > 0.0 and self.tracker != DEFAULT_TRACKER:
            raise ConfigError(
                f"doubt and the tracker {self.tracker} exclude each other: with a "
                "doubt the camera is covered; leave one of them out"
            )
        if self.doubt_turn > 0.0 and self.doubt == 0.0:
            raise ConfigError(
                f"doubt_turn is {self.doubt_turn:g} rad and doubt 0 m: give the "
                "largest distance, too, --doubt 0.005 for example"
            )
        varied = self._varied
        if len(varied) > num_envs:
            names = " and ".join(varied[0])
            raise ConfigError(
                f"vary gives {len(varied)} values of {names} to {num_envs} "
                f"environments; needed: --num-envs {len(varied)} or more"
            )

    def varied_options(self, index: int) -> dict[str, Any]:
        """Return the keyword arguments of one of the environments, by its number."""
        options = self.env_options()
        if self.doubt > 0.0:
            doubt = f"doubt={self.doubt}&turn={self.doubt_turn}"
            options["tracker"] = f"covered?{doubt}"
        values = self._varied
        return options | values[index % len(values)]

    @cached_property
    def _varied(self) -> list[dict[str, Any]]:
        """Return every set of values; the option that is given first changes first."""
        given = [] if self.vary is None else self.vary.split("&")
        return varied_values(given, self.task_class)


def varied_values(given: list[str], task: type[Task]) -> list[dict[str, Any]]:
    """Return every set of values; the option that is given first changes first.

    Args:
        given: NAME=A,B of each option.
        task: Whose options they are.

    Raises:
        ConfigError: No such option, one twice, or a value that is not of its type.
    """
    parts = [parse_values(text, task) for text in given]
    names = [name for name, _ in reversed(parts)]
    if len(set(names)) < len(names):
        raise ConfigError(
            f"vary names an option twice: {'&'.join(given)!r}; give all its values to "
            "one, NAME=A,B,C"
        )
    values = product(*(values for _, values in reversed(parts)))
    return [task.whole(dict(zip(names, each, strict=True))) for each in values]
