"""The installed distribution: its name on the package index, versions and extras."""

import importlib.metadata
from collections.abc import Iterator

DISTRIBUTION = "dovetail-robotics"
"""Name on the package index, where `dovetail` is another project since 2012."""


def installed_version(package: str) -> str:
    """Return the version of a package, or "not installed"; `dovetail` is this one."""
    name = DISTRIBUTION if package == "dovetail" else package
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def requirements_of(*extras: str) -> list[str]:
    """Return the packages that extras add on this Python, with their version bounds.

    Args:
        extras: Names of extras in pyproject.toml.

    Raises:
        ValueError: The distribution has no such extra.
    """
    known = importlib.metadata.metadata(DISTRIBUTION).get_all("Provides-Extra") or []
    unknown = sorted(set(extras) - set(known))
    if unknown:
        raise ValueError(f"no extra {', '.join(unknown)}; there are {', '.join(known)}")
    return list(dict.fromkeys(_requirements(extras)))


def _requirements(extras: tuple[str, ...]) -> Iterator[str]:
    from packaging.requirements import Requirement

    declared = importlib.metadata.requires(DISTRIBUTION) or []
    for requirement in map(Requirement, declared):
        marker = requirement.marker
        if marker is None or marker.evaluate({"extra": ""}):
            continue  # not of an extra
        if not any(marker.evaluate({"extra": extra}) for extra in extras):
            continue
        if requirement.name == DISTRIBUTION:  # the extra `all` names other extras
            yield from _requirements(tuple(sorted(requirement.extras)))
        else:
            requirement.marker = None
            yield str(requirement)
