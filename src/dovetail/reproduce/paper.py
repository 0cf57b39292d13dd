"""Results of the paper (Kaspar, Munoz Osorio, Bock 2020), to be shown beside ours."""

from typing import NamedTuple

from dovetail.reproduce.plan import ON_TWIN


class PaperRow(NamedTuple):
    """One row of the paper's transfer table, found on the real robot."""

    label: str
    """Name of the policy, as in our table."""
    variant: str
    """Variant that is trained for it here."""
    peg: str
    """Shape of peg and hole; all were trained with the square one."""
    cells: tuple[str, ...]
    """Successes of tries at each hole pose."""


_ALL = ("20/20", "20/20", "20/20")

TRANSFER = (
    PaperRow("stack 0", "stack-0", "square", _ALL),
    PaperRow("stack 4", "stack-4", "square", _ALL),
    PaperRow("stack 0, triangle", "stack-0", "triangle", _ALL),
    PaperRow("stack 4, triangle", "stack-4", "triangle", ("18/20", "20/20", "19/20")),
    PaperRow("dynamics randomisation", "randomised", "square", _ALL),
    PaperRow(
        "dynamics randomisation, triangle",
        "randomised",
        "triangle",
        ("20/20", "20/20", "10/20"),
    ),
    PaperRow("trained on the twin itself, one pose", ON_TWIN, "square", ("20/20",)),
)
"""The seven rows; in the paper the last is "trained on the real robot"."""

ROBUSTNESS = {
    "shift": "worked up to 20 mm",
    "search": "worked up to 20 mm",
    "push": "random pushes of up to 30 N; no rate given",
    "speed": "the hole moved during the episode; no rate given",
    "below": "starts below the surface; no rate given",
}
"""Statement of the paper about each test of robustness, on the real robot."""
