"""Settings in sections, which also have one flat name each.

A section is a frozen dataclass in a field of another. Every setting, however deep, has
its own short name: files, command lines and callers say it, and nothing but the fields
themselves lists it.
"""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import cache, reduce
from typing import Any, ClassVar, NamedTuple, Self, TypeGuard, get_args

from tyro.conf import Fixed

from dovetail.control.period import format_period
from dovetail.control.ranges import check_ranges
from dovetail.errors import ConfigError, did_you_mean

TIMES = ("period", "delay")
"""Settings that a command line writes with their unit, as 5ms."""

Trail = tuple[str, ...]
"""Fields that lead to a setting, its own the last."""


def option_words(name: str, value: Any) -> list[str]:
    """Return a setting as the words of a command line that give it."""
    option = name.replace("_", "-")
    if isinstance(value, bool):
        return [f"--{option}" if value else f"--no-{option}"]
    if name in TIMES:
        value = format_period(value)
    values = value if isinstance(value, list | tuple) else [value]
    return [f"--{option}", *map(str, values)]


class Setting(NamedTuple):
    """A field that is no section."""

    trail: Trail
    owner: type
    """The section that has it."""
    kind: Any
    """Type, as it is written."""
    default: Any
    """Default; MISSING where a value must be given."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Section:
    """Settings that belong together, checked when they are made."""

    owner: ClassVar[str] = ""
    """Owner of the settings, put before a name in messages."""

    def __post_init__(self) -> None:
        """Refuse what is out of its range."""
        check_ranges(self, self.owner)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sectioned:
    """Settings that are made, changed and read by their flat names, too."""

    whose: ClassVar[str] = "these settings"
    """Name of the settings in messages, such as "the limits"."""

    @classmethod
    def of(cls, **given: Any) -> Self:
        """Return the usual settings with these changed, by their flat names.

        Raises:
            ConfigError: See `having`.
        """
        return _made(cls, cls._trails(given))

    def having(self, **given: Any) -> Self:
        """Return these settings with others changed, by their flat names.

        Raises:
            ConfigError: An unknown name (lists the known ones), or a value out of
                range.
        """
        return replace(self, **_changed(vars(self), self._trails(given)))

    def flat(self) -> dict[str, Any]:
        """Return every setting by its flat name."""
        return {
            name: reduce(lambda at, part: vars(at)[part], known.trail, self)
            for name, known in settings_in(type(self)).items()
        }

    def _settle(self, **given: Any) -> None:
        """Change settings of this object itself, while it is made."""
        for name, value in _changed(vars(self), self._trails(given)).items():
            object.__setattr__(self, name, value)

    @classmethod
    def _trails(cls, given: Mapping[str, Any]) -> dict[Trail, Any]:
        known = settings_in(cls)
        if unknown := sorted(set(given) - set(known)):
            names = ", ".join(name + did_you_mean(name, known) for name in unknown)
            raise ConfigError(
                f"unknown settings of {cls.whose}: {names}; known: {', '.join(known)}"
            )
        return {
            known[name].trail: tuple(value) if isinstance(value, list) else value
            for name, value in given.items()
        }


@cache
def settings_in(kind: type) -> Mapping[str, Setting]:
    """Return every setting of a dataclass and of the sections in it, by its flat name.

    What is `Fixed` in settings that are a section of others is not theirs to choose,
    and is left out.

    Args:
        kind: The dataclass.
    """
    found: dict[str, Setting] = {}
    for f in fields(kind):
        section, usual = f.type, _usual(f)
        if not is_section(section):
            found[f.name] = Setting((f.name,), kind, section, usual)
            continue
        for name, inner in settings_in(section).items():
            if issubclass(section, Sectioned) and Fixed in get_args(inner.kind):
                continue
            if name in found:
                raise TypeError(f"{kind.__name__} has two settings called {name}")
            default = inner.default
            if usual is not MISSING:
                default = reduce(lambda at, part: vars(at)[part], inner.trail, usual)
            found[name] = inner._replace(trail=(f.name, *inner.trail), default=default)
    return found


def is_section(kind: Any) -> TypeGuard[type]:
    """Say whether the type of a field is a section."""
    return isinstance(kind, type) and is_dataclass(kind)


def _usual(field: Any) -> Any:
    if field.default_factory is not MISSING:
        return field.default_factory()
    return field.default


def _made(kind: type, given: Mapping[Trail, Any]) -> Any:
    """Return a dataclass with these settings, and the usual ones besides."""
    usual = {f.name: _usual(f) for f in fields(kind)}
    after, deeper = _by_section(given)
    for f in fields(kind):
        if usual[f.name] is MISSING and is_section(f.type):
            after[f.name] = _made(f.type, deeper.pop(f.name, {}))
    return kind(**after, **_sections_changed(usual, deeper))


def _changed(before: Mapping[str, Any], given: Mapping[Trail, Any]) -> dict[str, Any]:
    """Return the fields that are another after these settings are given."""
    after, deeper = _by_section(given)
    return after | _sections_changed(before, deeper)


def _by_section(
    given: Mapping[Trail, Any],
) -> tuple[dict[str, Any], dict[str, dict[Trail, Any]]]:
    """Return settings of the dataclass itself, and those of each section in it."""
    own: dict[str, Any] = {}
    deeper: dict[str, dict[Trail, Any]] = {}
    for (name, *rest), value in given.items():
        if rest:
            deeper.setdefault(name, {})[tuple(rest)] = value
        else:
            own[name] = value
    return own, deeper


def _sections_changed(
    before: Mapping[str, Any], deeper: Mapping[str, Mapping[Trail, Any]]
) -> dict[str, Any]:
    return {
        name: replace(before[name], **_changed(vars(before[name]), inner))
        for name, inner in deeper.items()
    }
