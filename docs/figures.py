"""Writes the figures of the pages that commands give; `make figures` calls it.

docs/figures.toml says which commands, what to look for in their output, and the
sentence of a page that holds the values.

    python docs/figures.py                  run every command, rewrite the pages
    python docs/figures.py --only tracking  only commands with this word in them
    python docs/figures.py --check          rewrite nothing; rc 1 if a page differs
"""

import argparse
import os
import re
import shlex
import string
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
FILE = Path(__file__).with_suffix(".toml")
Value = float | str
_SHOWN = r"[-+]?\d[\d.]*|[\w-]+"
"""A value in a page."""


@dataclass(frozen=True)
class Figure:
    """Values of a command's output, and the sentence of a page that shows them."""

    find: str
    """Regular expression whose groups are the values."""
    page: str
    """Page, from the project's folder."""
    text: str
    """Sentence with a placeholder for each value; {any} stands for another figure."""
    every: bool = False
    """Whether the groups of all matches are values, not of the first alone."""
    take: str = ""
    """"max" takes the largest value alone."""
    within: float = 0.1
    """How far a value may differ in a test [1]."""

    def read(self, output: str) -> tuple[Value, ...]:
        """Return the values in what the commands printed.

        Raises:
            ValueError: The output has none; says what was looked for.
        """
        matches = list(re.finditer(self.find, output))
        if not matches:
            raise ValueError(f"{self.find!r} is not in the output:\n{output[-3000:]}")
        found = matches if self.every else matches[:1]
        values = [_value(group) for match in found for group in match.groups()]
        if self.take == "max":
            return (max(float(value) for value in values),)
        return tuple(values)

    def write(self, values: Sequence[Value]) -> list[str]:
        """Return the values as the page writes them.

        Raises:
            ValueError: More or fewer values than placeholders.
        """
        formats = [part for _, name, part, _ in self._parts() if name == ""]
        if len(formats) != len(values):
            raise ValueError(f"{self.text!r} does not take the values {values}")
        return [
            f"{value:{part or 'g'}}" if isinstance(value, float) else value
            for value, part in zip(values, formats, strict=True)
        ]

    def locate(self) -> re.Match[str]:
        """Return where the page has the sentence; its groups are the values.

        Raises:
            ValueError: The page does not have it exactly once.
        """
        pattern = "".join(
            r"\s+".join(re.escape(word) for word in re.split(r"\s+", words))
            + {None: "", "": rf"({_SHOWN})", "any": rf"(?:{_SHOWN})"}[name]
            for words, name, _, _ in self._parts()
        )
        found = list(re.finditer(pattern, (ROOT / self.page).read_text()))
        if len(found) != 1:
            raise ValueError(f"{self.page} has {self.text!r} {len(found)} times, not 1")
        return found[0]

    def replace(self, values: Sequence[Value]) -> None:
        """Write the values into the page."""
        match, path = self.locate(), ROOT / self.page
        page = path.read_text()
        for i, words in reversed(list(enumerate(self.write(values), 1))):
            begin, end = match.span(i)
            page = page[:begin] + words + page[end:]
        path.write_text(page)

    def _parts(self) -> list[tuple[str, str | None, str | None, str | None]]:
        return list(string.Formatter().parse(self.text))


@dataclass(frozen=True)
class Command:
    """Commands that run in one folder, one after the other, and their figures."""

    run: tuple[str, ...]
    figures: tuple[Figure, ...]
    is_slow: bool = False
    """Whether it takes longer than 15 s."""

    def output(self) -> str:
        """Run the commands and return what they print.

        One that ends with `&` runs beside the later ones, until the last has ended.

        Raises:
            RuntimeError: A command failed; has its output.
        """
        printed, beside = "", []
        with tempfile.TemporaryDirectory() as folder:
            try:
                for line in self.run:
                    if line.endswith("&"):
                        words = _words(line[:-1])
                        beside.append(_start(words, folder, subprocess.DEVNULL))
                        time.sleep(3.0)  # it has a port to open
                        continue
                    process = _start(_words(line), folder, subprocess.PIPE)
                    text, _ = process.communicate()
                    printed += text
                    if process.returncode:
                        raise RuntimeError(f"{line} ended with an error:\n{text}")
            finally:
                for process in beside:
                    process.terminate()
                    process.wait()
        return printed


def load() -> list[Command]:
    """Return the commands of docs/figures.toml, with their figures."""
    return [
        Command(
            run=tuple(entry["run"]),
            figures=tuple(Figure(**figure) for figure in entry["figure"]),
            is_slow=entry.get("slow", False),
        )
        for entry in tomllib.loads(FILE.read_text())["command"]
    ]


def _value(group: str) -> Value:
    try:
        return float(group)
    except ValueError:
        return group


def _words(line: str) -> list[str]:
    """Return a command's words, with this interpreter and the project's files."""
    first, *words = shlex.split(line)
    if first == "dovetail":
        return [sys.executable, "-m", "dovetail", *words]
    if first == "python":
        return [sys.executable, str(ROOT / words[0]), *words[1:]]
    raise ValueError(f"{line!r} begins neither with dovetail nor with python")


def _start(words: list[str], folder: str, out: int) -> "subprocess.Popen[str]":
    wide: dict[str, Any] = os.environ | {"COLUMNS": "200", "NO_COLOR": "1"}
    return subprocess.Popen(
        words, cwd=folder, stdout=out, stderr=out and subprocess.STDOUT, text=True,
        env=wide,
    )  # fmt: skip


def main() -> int:
    """Run the commands, and write or compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="word in the commands to run")
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    given = parser.parse_args()
    differences = 0
    for command in load():
        if not any(given.only in line for line in command.run):
            continue
        print("\n".join(command.run), flush=True)
        output = command.output()
        for figure in command.figures:
            values = figure.read(output)
            now, then = figure.write(values), list(figure.locate().groups())
            if now == then:
                continue
            differences += 1
            print(f"  {figure.page}: {' '.join(then)} -> {' '.join(now)}")
            if not given.check:
                figure.replace(values)
    print(f"{differences} figures {'differ' if given.check else 'were changed'}")
    return int(given.check and differences > 0)


if __name__ == "__main__":
    sys.exit(main())
