"""Result of one check of the doctor."""

from typing import Any, Literal, NamedTuple


class Check(NamedTuple):
    """Result of one check."""

    name: str
    status: Literal["ok", "missing", "broken"]
    detail: str
    is_essential: bool = True


def signed(values: Any, digits: int = 1) -> str:
    """Return numbers with their signs, as a list of a check's detail."""
    return " ".join(f"{value:+.{digits}f}" for value in values)
