"""XML files that describe an arm: read within bounds, each element with its line."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np

from dovetail.errors import ConfigError
from dovetail.reading import read_bytes
from dovetail.types import Array

BYTES = 4_000_000
"""Largest file [bytes]."""
ELEMENTS = 5_000
"""Most elements of a file."""
DEPTH = 100
"""Deepest nesting of elements."""


class Node(ET.Element):
    """An XML element that knows where it stands."""

    place: str = ""
    """Line, and the file's name if another file includes it: for messages."""


def read_xml(path: Path, *, included: bool = False) -> Node:
    """Read an XML file. Text between the elements is left out.

    Args:
        path: A regular file of at most `BYTES`, `ELEMENTS` and `DEPTH`.
        included: Whether another file includes it, so that places name it.

    Raises:
        ConfigError: Unreadable, not XML, too large, or with a DOCTYPE: entities can
            make a short file endless.
    """
    builder = ET.TreeBuilder(element_factory=Node)
    parser = expat.ParserCreate()
    counts = {"depth": 0, "elements": 0}

    def start(tag: str, attributes: dict[str, str]) -> None:
        counts["depth"] += 1
        counts["elements"] += 1
        for name, most in (("depth", DEPTH), ("elements", ELEMENTS)):
            if counts[name] > most:
                raise ConfigError(
                    f"{path}, line {parser.CurrentLineNumber}: the {name} of a robot "
                    f"file may be {most} at most"
                )
        node = builder.start(tag, attributes)
        where = f"line {parser.CurrentLineNumber}"
        vars(node)["place"] = f"{path.name}, {where}" if included else where

    def end(tag: str) -> None:
        counts["depth"] -= 1
        builder.end(tag)

    def refuse(*_: Any) -> None:
        raise ConfigError(
            f"{path} has a DOCTYPE, which is not read; remove it: a robot file needs "
            "none"
        )

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(read_bytes(path, BYTES), True)
    except OSError as error:
        raise ConfigError(
            f"cannot read robot file {path}: {error.strerror or error}"
        ) from error
    except (expat.ExpatError, LookupError, ValueError) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"{path} is not XML: {error}") from error
    node = builder.close()
    assert isinstance(node, Node)
    return node


def named(node: ET.Element) -> str:
    """Return an element for a message: its tag, name and line."""
    name = node.get("name")
    words = f"<{node.tag}>" if name is None else f"{node.tag} {shown(name)}"
    place = node.place if isinstance(node, Node) else ""
    return f"{words} ({place})" if place else words


def shown(name: str) -> str:
    """Return a name from a file for a message, cut where it is too long."""
    return name if len(name) <= 80 else f"{name[:77]}..."


def listed(names: "list[str]") -> str:
    """Return names for a message: the first thirty."""
    more = f" and {len(names) - 30} more" if len(names) > 30 else ""
    return ", ".join(map(shown, names[:30])) + more if names else "none"


def numbers(
    node: ET.Element, attribute: str, usual: str | None = None, counts: Any = (3,)
) -> Array:
    """Return the numbers of an attribute.

    Args:
        node: The element.
        attribute: Its name.
        usual: What stands for an attribute that is absent; None is a refusal.
        counts: How many numbers it may have.

    Raises:
        ConfigError: Absent, not finite numbers, or another count of them.
    """
    text = node.get(attribute, usual)
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.array([np.nan])
    if len(values) not in counts or not np.isfinite(values).all():
        given = "missing" if text is None else repr(shown(text))
        many = " or ".join(map(str, counts))
        raise ConfigError(
            f"{named(node)}: {attribute} is {given}; it must be {many} finite "
            f"number{'' if counts == (1,) else 's'}"
        )
    return values


def number(node: ET.Element, attribute: str, usual: str | None = None) -> float:
    """Return the one number of an attribute; see `numbers`."""
    return float(numbers(node, attribute, usual, (1,))[0])


def write_xml(root: ET.Element) -> tuple[str, list[str]]:
    """Return XML with one element a line, and where each line comes from.

    Returns:
        The text, and for each of its lines the place of the element that begins there
        ("" for a line on which one ends).
    """
    places: list[str] = []

    def count(node: ET.Element) -> None:
        places.append(node.place if isinstance(node, Node) else "")
        node.tail, node.text = "\n", "\n" if len(node) else None
        for child in node:
            count(child)
        if len(node):
            places.append("")

    count(root)
    return ET.tostring(root, encoding="unicode"), places
