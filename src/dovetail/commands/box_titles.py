"""Boxes of tyro's help have the titles of the groups in `help_page`.

tyro titles a section's box by the fields that lead to it, as "cell.task-options
options". It has no setting for that: a title is the section's name, and " options".
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Any, Self

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from dovetail.commands.help_page import title_of, to_title
from dovetail.control.sections import is_section
from dovetail.tasks.options import TaskOptions

Rule = Callable[[StructTypeInfo], StructConstructorSpec | None]


class _Title(str):
    """A name to which nothing is added."""

    __slots__ = ()

    def __add__(self, _: str, /) -> Self:
        return self


def titled_by(*rules: Rule) -> ConstructorRegistry:
    """Return rules for tyro: its own after these, and the boxes of both titled."""
    registry, is_asking = ConstructorRegistry(), False
    for rule in rules:
        registry.struct_rule(rule)

    @registry.struct_rule
    def _(info: StructTypeInfo) -> StructConstructorSpec | None:
        nonlocal is_asking
        if is_asking:
            return None
        is_asking = True
        try:
            spec = registry.get_struct_spec(info)  # as the other rules have it
        finally:
            is_asking = False
        if not isinstance(spec, StructConstructorSpec):
            return None
        return replace(spec, fields=tuple(map(_titled, spec.fields)))

    return registry


def _titled(field: StructFieldSpec) -> StructFieldSpec:
    """Return a field; a section with its title, and no line below that says it too."""
    kind: Any = field.type
    if not is_section(kind) and kind is not TaskOptions:
        return field
    said = field.helptext() if callable(field.helptext) else field.helptext
    title = title_of(kind)
    below = "" if to_title(said or "") == title else None
    named = tyro.conf.arg(name=_Title(title), prefix_name=False, help=below)
    return replace(field, type=Annotated[kind, named])
