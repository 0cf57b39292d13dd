"""`dovetail twin`: what a twin is made of."""

from dataclasses import dataclass
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from dovetail.plants.twin import list_twins, load_twin


@dataclass(frozen=True, kw_only=True)
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


@dataclass(frozen=True, kw_only=True)
class TwinShow:
    """Print a twin's file: every key of it, with its unit."""

    name: Annotated[str, tyro.conf.Positional]
    """Name of a shipped twin, or a .toml file."""

    def run(self, console: Console) -> int:
        """Print the file as it can be saved and read again."""
        is_ascii = not console.encoding.startswith("utf")
        text = load_twin(self.name).to_toml(is_ascii=is_ascii).rstrip()
        console.print(text, highlight=False, soft_wrap=True)
        return 0


Twin = (
    Annotated[TwinList, tyro.conf.subcommand("list")]
    | Annotated[TwinShow, tyro.conf.subcommand("show")]
)
