"""A contact parameter as a log tells it, or why it does not."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

from dovetail.plants.twin import Twin
from dovetail.settings import ranges_of

WIDEST = 0.3
"""Widest half interval of a value that is called identified, as a share of it [1]."""


@dataclass(frozen=True)
class ContactEstimate:
    """Value and interval of one contact parameter."""

    name: str
    """Field of a twin."""
    unit: str
    value: float | None
    """Estimate; None where there is none."""
    half_width: float | None
    """Half of the 95 % interval."""
    reason: str = ""
    """Reason why it is not identified; empty if it is."""

    def judged(self) -> Self:
        """Return it; not identified if no model may have it or its interval is wide."""
        if self.reason or self.value is None or self.half_width is None:
            return self
        allowed = ranges_of(Twin)[self.name]
        if not 0.0 < self.value <= allowed.high:
            reason = f"it is not above 0 and up to {allowed.high:g} {self.unit}"
            return replace(self, reason=reason)
        share = self.half_width / self.value
        if share <= WIDEST:
            return self
        reason = (
            f"its 95 % interval is +-{100.0 * share:.0f} % of it, more than "
            f"{100.0 * WIDEST:g} %"
        )
        return replace(self, reason=reason)

    def numbers(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return asdict(self)

    def sentence(self) -> str:
        """Say it in words."""
        value = "no value" if self.value is None else f"{self.value:.4g}"
        width = "" if self.half_width is None else f" +- {self.half_width:.2g}"
        said = f"{self.name} {value}{width} {self.unit}".removesuffix(" 1")
        return f"{said}: not identified, {self.reason}" if self.reason else said


def with_contact(model: Twin, estimates: Sequence[ContactEstimate]) -> Twin:
    """Return a model with the values that are identified."""
    known = {one.name: one.value for one in estimates if not one.reason}
    return replace(model, **known)
