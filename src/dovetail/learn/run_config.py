"""Length of a training, and settings of its runs and their folders."""

from pathlib import Path
from typing import Annotated

from dovetail.errors import ConfigError
from dovetail.settings import Range, settings


@settings()
class LengthConfig:
    """Length of the training."""

    steps: Annotated[int, Range(1, 1e9, "steps")] = 60_000
    """Environment steps at most; see `until`."""
    until: Annotated[float | None, Range(0.0, 1.0, "1")] = None
    """Success that ends the run before `steps` [1]: 0.98, on an arm 1 (never).
    A test of `test_episodes` proves it by the lower end of its Wilson 95 % interval. Or
    two in a row show it, the second no better. An arm's time would go into tests."""
    test_episodes: Annotated[int, Range(1, 1e6, "episodes")] = 300
    """Episodes of a test, without exploration; see `until`."""
    settle: Annotated[int, Range(1, 1e9, "steps")] = 8000
    """Steps in which the rate falls once nine of ten episodes succeed.
    Then the first test is made, and others after half as many steps each."""

    @property
    def asked_success(self) -> float:
        """Success that ends the run before `steps` [1]; 1 for never."""
        return 1.0 if self.until is None else self.until


@settings()
class RunsConfig:
    """The runs and their folder."""

    out: Path | None = None
    """Run folder, new or empty unless it is resumed; default a new one in runs. That is
    named by part or environment and the time."""
    resume: bool = False
    """Continue the run in `out` from its newest checkpoint, with its settings. On the
    command line only an arm outside this process has to be given again."""
    seed: Annotated[int, Range(0, 2**31 - 1, "1")] = 0
    """Seed of everything random.
    With `seeds` it is that of the first run."""
    seeds: Annotated[int, Range(1, 1000, "runs")] = 1
    """Runs with seeds seed, seed + 1, ..., as many at once as cores."""
    num_envs: Annotated[int, Range(1, 256, "environments")] = 16
    """Environments stepped by one process; on an arm always 1. They are stepped at the
    same time where `threads` says so, in turn otherwise."""
    threads: Annotated[int, Range(0, 256, "threads")] = 0
    """Threads that simulate them, with MuJoCo only; 0 is one for each core. These are
    the cores that this process may use, shared by `seeds`. What is learnt is the same
    with any number."""
    checkpoint_interval: Annotated[int, Range(1, 1e9, "steps")] = 5000
    """Steps between checkpoints: the most that a kill can lose."""
    eval_episodes: Annotated[int, Range(0, 1e6, "episodes")] = 200
    """Episodes of the evaluation at the end; 0 leaves it out."""

    @property
    def folder(self) -> Path:
        """The run folder, absolute.

        Raises:
            ConfigError: None is given.
        """
        if self.out is None:
            raise ConfigError(
                "out is not given: say with --out FOLDER where the run is (a training "
                "prints its folder when it begins)"
            )
        return self.out.expanduser().absolute()
