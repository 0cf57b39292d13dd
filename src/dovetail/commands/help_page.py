"""The help of a command with many options: in groups, a line for each.

A line has the first sentence of the field's docstring; `--help-all` prints the whole
docstring.
"""

import inspect
import shutil
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import MISSING
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from tyro.constructors import PrimitiveConstructorSpec

from dovetail.commands.field_words import field_words
from dovetail.control.period import format_period
from dovetail.control.sections import TIMES, Setting, settings_in

Groups = Mapping[str, Sequence[str]]
"""Title of each group, and the settings in it."""

_WIDTH = 100
_COLUMN = 28
"""Column where sentences begin; after a long option they begin on the next line."""
_WORDS: Mapping[Any, str] = {int: "N", float: "X", str: "NAME", Path: "PATH"}


def help_page(
    settings: type, name: str, groups: Groups, own: Mapping[str, str] | None = None
) -> str:
    """Return the help of a command.

    Args:
        settings: The command's dataclass.
        name: Its name.
        groups: Every setting of it, in one group each.
        own: Options that stand where the field `task_options` is, and their words.
    """
    known = settings_in(settings)
    needed = [_metavar(one.kind) for one in known.values() if one.default is MISSING]
    lines = [
        " ".join(["usage: dovetail", name, *needed, "[OPTIONS]"]),
        "",
        *textwrap.wrap(inspect.getdoc(settings) or "", _width()),
        "--help-all says all there is to say of each option.",
    ]
    for title, names in groups.items():
        lines += ["", title]
        for field in names:
            if own is not None and field == "task_options":
                for option, sentence in own.items():
                    lines += _rows(option, sentence, "")
                continue
            setting = known[field]
            sentence = field_words(setting.owner)[field]
            lines += _rows(_option(setting), sentence, _default(setting))
    return "\n".join(lines)


def sections_of(settings: type) -> Groups:
    """Return the settings of each section of a command, titled by its docstring."""
    groups: dict[str, list[str]] = {}
    for name, setting in settings_in(settings).items():
        title = "options"
        if setting.owner is not settings:
            title = title_of(setting.owner)
        groups.setdefault(title, []).append(name)
    return groups


def title_of(section: type) -> str:
    """Return the title of a section: the first sentence of its docstring."""
    return to_title((inspect.getdoc(section) or "").partition(".")[0])


def to_title(sentence: str) -> str:
    """Return a sentence as a title."""
    return sentence[:1].lower() + sentence[1:].rstrip(".")


def _option(setting: Setting) -> str:
    """Return an option as it is typed, with the word that stands for its value."""
    kind, default = setting.kind, setting.default
    if default is MISSING:
        return _metavar(kind)
    name = setting.trail[-1].replace("_", "-")
    for note in get_args(kind)[1:] if get_origin(kind) is Annotated else ():
        name = vars(note).get("name") or name
    if is_switch(kind) or default is True:
        return f"--[no-]{name}"
    if default is False:
        return f"--{name}"
    return f"--{name} {_metavar(kind)}"


def is_switch(kind: Any) -> bool:
    """Say whether an option is yes, no, or left out."""
    return set(get_args(kind)) == {bool, type(None)}


def _metavar(kind: Any) -> str:
    parts = get_args(kind)
    if get_origin(kind) is Annotated:
        for note in parts[1:]:
            if isinstance(note, PrimitiveConstructorSpec):
                return str(note.metavar)
            if metavar := vars(note).get("metavar"):
                return str(metavar)
        return _metavar(parts[0])
    if get_origin(kind) is Literal:
        return "WORD"
    if get_origin(kind) is tuple:
        one = _metavar(parts[0])
        return f"{one}.." if parts[-1] is Ellipsis else " ".join([one] * len(parts))
    for part in parts:  # of a union: what it is where it is given
        if part is not type(None):
            return _metavar(part)
    return _WORDS[kind]


def _default(setting: Setting) -> str:
    value = setting.default
    if isinstance(value, bool) or value in (MISSING, None, (), "none"):
        return ""
    if setting.trail[-1] in TIMES and isinstance(value, float):
        return f" ({format_period(value)})"
    values = value if isinstance(value, tuple) else (value,)
    return f" ({' '.join(str(part) for part in values)})"


def _width() -> int:
    return min(_WIDTH, shutil.get_terminal_size((_WIDTH, 24)).columns)


def _rows(option: str, sentence: str, default: str) -> list[str]:
    room = max(20, _width() - _COLUMN)
    text = textwrap.wrap(f"{sentence}{default}", room, break_on_hyphens=False)
    first = f"  {option:{_COLUMN - 4}}  "
    if len(first) > _COLUMN:
        return [first.rstrip(), *(" " * _COLUMN + line for line in text)]
    return [first + text[0], *(" " * _COLUMN + line for line in text[1:])]
