"""`dovetail twin`: what a twin is made of."""

from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from dovetail.plants.plant import Engine
from dovetail.plants.sampled_twin import sample_twin
from dovetail.plants.twin import Twin as TwinConfig
from dovetail.plants.twin import list_twins, load_twin
from dovetail.settings import settings


@settings()
class TwinList:
    """List the shipped twins."""

    def run(self, console: Console) -> int:
        """Print one line per twin."""
        table = Table()
        for name in ("twin", "engine", "description"):
            table.add_column(name)
        for name in list_twins():
            twin = load_twin(name)
            table.add_row(name, twin.engine, twin.description)
        console.print(table)
        console.print("write your own: dovetail twin show medium > mine.toml")
        return 0


@settings()
class TwinShow:
    """Print a twin's file: every key of it, with its unit."""

    name: Annotated[str, tyro.conf.Positional]
    """Name of a shipped twin, or a .toml file."""

    def run(self, console: Console) -> int:
        """Print the file as it can be saved and read again."""
        _print_file(load_twin(self.name), console)
        return 0


@settings()
class TwinSample:
    """Draw a twin at random and print its file: another robot for each seed."""

    seed: int = 0
    """One seed is always the same twin, whatever its engine."""
    engine: Engine = "mujoco"
    """Physics engine."""

    def run(self, console: Console) -> int:
        """Print the file as it can be saved and read again."""
        _print_file(sample_twin(self.seed, self.engine), console)
        return 0


def _print_file(twin: TwinConfig, console: Console) -> None:
    is_ascii = not console.encoding.startswith("utf")
    text = twin.to_toml(is_ascii=is_ascii).rstrip()
    console.print(text, highlight=False, soft_wrap=True)


Twin = (
    Annotated[TwinList, tyro.conf.subcommand("list")]
    | Annotated[TwinShow, tyro.conf.subcommand("show")]
    | Annotated[TwinSample, tyro.conf.subcommand("sample")]
)
