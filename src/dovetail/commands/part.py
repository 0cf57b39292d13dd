"""`dovetail part`: two meshes become a part to train on, or a part file is shown."""

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from shlex import quote
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from dovetail.errors import LogError
from dovetail.files import dated_folder, require_empty, require_writable, write_atomic
from dovetail.settings import Range, settings

_STEPS = 5
"""Parts of the work of a check."""


@settings()
class PartCheck:
    """Check a plug and its socket, two meshes; write the part that train takes."""

    plug: Annotated[Path, tyro.conf.Positional]
    """Mesh of the plug, STL, OBJ, PLY or 3MF, where it stands in the end."""
    socket: Annotated[Path, tyro.conf.Positional]
    """Mesh of the socket, in the same frame."""
    units: Literal["mm", "cm", "m", "inch"] | None = None
    """Unit of both files; default a 3MF's own, else guessed by the size."""
    axis: Literal["-z", "+z", "-x", "+x", "-y", "+y"] | None = None
    """Way in, in the files' axes; default the first that is free."""
    density: Annotated[float, Range(1.0, 25000.0, "kg/m3")] = 1200.0
    """Density of the plug [kg/m3]. Default a printed plastic."""
    out: Path | None = None
    """Folder for part.toml and the report, new or empty; default one by the time. Its
    name is the part's."""

    def run(self, console: Console) -> int:
        """Check the pair; 1 where it cannot be trained."""
        folder = (self.out or dated_folder("parts", f"{self.plug.stem}-")).expanduser()
        require_empty(folder)
        require_writable(folder, "--out")
        with tempfile.TemporaryDirectory() as draft:
            with _bar(console) as begin:
                facts, problems = self._write(Path(draft), folder, begin)
            _put(Path(draft), folder)
        table = Table(box=None, show_header=False, pad_edge=False)
        for name, value in facts:
            table.add_row(name, value)
        console.print(table)
        console.print(f"{folder}: part.toml, report.html", soft_wrap=True)
        for problem in problems:
            console.print(f"no go: {problem}", soft_wrap=True, highlight=False)
        if not problems:
            console.print(f"go:\n{_next(folder)}", soft_wrap=True, highlight=False)
        return int(bool(problems))

    def _write(
        self, draft: Path, folder: Path, begin: Callable[[str], None]
    ) -> tuple[list[tuple[str, str]], tuple[str, ...]]:
        """Fill the folder; return the facts, and the reasons against the pair."""
        from dovetail.meshes.check import check_pair
        from dovetail.meshes.pair import convert
        from dovetail.meshes.part_folder import write_part
        from dovetail.meshes.read import read_meshes, short_name
        from dovetail.meshes.report import to_html, to_json
        from dovetail.meshes.words import rows

        begin("read")
        meshes = read_meshes(self.plug, self.socket, self.units)
        begin("cut into convex pieces")
        name = (
            short_name(folder.resolve().name) if self.out else ""
        )  # by the time says nothing
        found = convert(*meshes, axis=self.axis, density=self.density, name=name)
        check = check_pair(found, begin)
        facts = rows(check, is_axis_given=self.axis is not None)
        page = to_html(check, facts, _next(folder), begin)
        write_part(found, draft)
        write_atomic(draft / "report.html", page)
        write_atomic(draft / "report.json", to_json(check))
        return facts, check.problems


@settings()
class PartShow:
    """Say what a part file makes: gap, depth, mass and convex pieces."""

    part: Annotated[Path, tyro.conf.Positional]
    """A part.toml, see docs/your-own-part.md."""

    def run(self, console: Console) -> int:
        """Print the facts, or why no command would take it."""
        from dovetail.tasks.insert.task import Insert

        task = Insert(part=str(self.part))
        name, gap = task.describe()
        held, fixture = task.held(), task.fixture(0.0)
        mass = sum(shape.mass for shape in held.primitives)
        reach = -float(held.corners[:, 2].min())
        table = Table(box=None, show_header=False, pad_edge=False)
        table.add_row("part", f"{name}, {gap}")
        table.add_row("depth", f"{1e3 * task.depths()[0]:g} mm")
        table.add_row("held part", f"{1e3 * mass:.3g} g, {1e3 * reach:.4g} mm long")
        table.add_row(
            "convex pieces",
            f"held {len(held.primitives)}, fixture {len(fixture.primitives)}",
        )
        console.print(table)
        return 0


def _next(folder: Path) -> str:
    """Return the commands that try a shipped policy at once, and train one."""
    part, name = quote(str(folder / "part.toml")), folder.absolute().name
    return (
        f"dovetail evaluate insert_any --part {part} --twin medium\n"
        f"dovetail train --part {part} --out {quote(f'runs/{name}')}"
    )


def _put(draft: Path, folder: Path) -> None:
    """Put a folder's files into their place, all of them or none."""
    place = folder.resolve()
    is_there = place.is_dir()
    try:
        beside = place if is_there else place.parent
        beside.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".part-", dir=beside) as made:
            whole = Path(made) / "whole"
            whole.mkdir()
            for file in draft.iterdir():
                shutil.copy(file, whole)
            if not is_there:
                whole.replace(place)
                return
            # It may be the folder that the user is in: it stays. Part.toml is last.
            for file in sorted(whole.iterdir(), key=lambda one: one.stem == "part"):
                file.replace(place / file.name)
    except OSError as error:
        raise LogError(
            f"cannot write {folder}: {error.strerror}; free some space or choose "
            "another --out"
        ) from error


@contextmanager
def _bar(console: Console) -> Iterator[Callable[[str], None]]:
    """Show a bar that each part of the work moves on."""
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        bar = progress.add_task("", total=_STEPS)
        begun: list[str] = []

        def begin(name: str) -> None:
            progress.update(bar, completed=len(begun), description=name)
            begun.append(name)

        yield begin


Part = (
    Annotated[PartCheck, tyro.conf.subcommand("check")]
    | Annotated[PartShow, tyro.conf.subcommand("show")]
)
