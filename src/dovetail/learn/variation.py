"""What differs between the episodes of a training, and the policy is not told."""

from dataclasses import dataclass
from typing import Any

from dovetail.errors import ConfigError
from dovetail.learn.env_settings import EnvSettings
from dovetail.tasks.options import parse_values


@dataclass(frozen=True, kw_only=True)
class Variation(EnvSettings):
    """A fixture that is not where it is believed, and values of the task's options."""

    vary: str | None = None
    """Option of the task and a value for each environment in turn, NAME=A,B.
    The policy's file names the one that the task has."""
    doubt: float = 0.0
    """Largest distance of the fixture from where it is believed [m]. In each
    episode it is another; the policy is not told, reward and success are by the truth.
    On the command line it gives other options other defaults: see learn/searching.py.
    A search tilts the part, so that the task must let it."""
    doubt_turn: float = 0.0
    """Largest turn of the fixture from what is believed [rad].
    It is about the vertical; a doubt must be given, too."""

    def require_variation(self, num_envs: int) -> None:
        """Refuse a doubt beside a tracker, a turn without one, and too many values.

        Args:
            num_envs: Environments among which the values are shared.

        Raises:
            ConfigError: Says what to give.
        """
        if self.doubt > 0.0 and self.tracker != Variation.tracker:
            raise ConfigError(
                f"doubt and the tracker {self.tracker} exclude each other: with a "
                "doubt the camera is covered; leave one of them out"
            )
        if self.doubt_turn > 0.0 and self.doubt == 0.0:
            raise ConfigError(
                f"doubt_turn is {self.doubt_turn:g} rad and doubt 0 m: give the "
                "largest distance, too, --doubt 0.005 for example"
            )
        if self.vary is not None:
            name, values = parse_values(self.vary, self.task_class)
            if len(values) > num_envs:
                raise ConfigError(
                    f"vary gives {len(values)} values of {name} to {num_envs} "
                    f"environments; needed: --num-envs {len(values)} or more"
                )

    def varied_options(self, index: int) -> dict[str, Any]:
        """Return the keyword arguments of one of the environments of a training.

        Args:
            index: Which one.
        """
        options = self.env_options()
        if self.doubt > 0.0:
            doubt = f"doubt={self.doubt}&turn={self.doubt_turn}"
            options["tracker"] = f"covered?{doubt}"
        if self.vary is not None:
            name, values = parse_values(self.vary, self.task_class)
            options[name] = values[index % len(values)]
        return options
