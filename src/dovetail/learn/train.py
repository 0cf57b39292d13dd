"""Train a policy: one call from settings to weights, evaluation and provenance."""

from pathlib import Path

from rich.console import Console

from dovetail.learn.config import TrainConfig
from dovetail.learn.one_run import TrainResult, resume_command, train_one
from dovetail.learn.progress import ProgressBar
from dovetail.learn.run_folder import place_run
from dovetail.learn.seeds import train_seeds

__all__ = ["TrainConfig", "TrainResult", "train"]


def train(config: TrainConfig, console: Console | None = None) -> list[TrainResult]:
    """Train, evaluate and export one policy per seed.

    The run folder gets config.toml (and model.toml), progress.csv (a row per episode),
    tensorboard/, checkpoints/, policy.safetensors with policy.json, and
    evaluation.json. Several seeds each have such a folder, `seed-<n>`, inside it.

    Args:
        config: Settings.
        console: Where the progress goes; None is the standard error.

    Returns:
        One result per seed.

    Raises:
        ConfigError: A setting is wrong, or the run folder is not empty, in use, or
            cannot be resumed.
        MissingDependencyError: The extra `learn` is not installed.
        LogError: The disk is full; the last checkpoint is kept.
    """
    console = console or Console(stderr=True)
    config = place_run(config)
    way_on: list[str] = []

    def begin(folder: Path) -> None:
        """Say where a run is and how it goes on, before anything can end it."""
        way_on.append(resume_command(config, folder))
        say(f"training in {folder}\n  if it is cut short: {way_on[0]}")

    def say(text: str) -> None:
        console.print(text, soft_wrap=True, highlight=False)

    try:
        if config.seeds > 1:
            return train_seeds(config, console, begin)
        names = [f"seed {config.seed}"]
        with ProgressBar(config.steps, names, console) as bar:
            return [train_one(config, lambda status: bar.show(0, status), begin)]
    except KeyboardInterrupt:
        if way_on:
            say(f"cut short; go on with: {way_on[0]}")
        raise
