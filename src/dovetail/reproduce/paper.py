"""Results of the paper (Kaspar, Munoz Osorio, Bock 2020), to be shown beside ours."""

from typing import NamedTuple

from dovetail.reproduce.design import STACK


class PaperRow(NamedTuple):
    """One row of the paper's transfer table, found on the real robot."""

    label: str
    """Name of the policy, as in our table."""
    stack: int | None
    """Past steps that it sees; None for a randomised policy."""
    peg: str
    """Shape of peg and hole; all were trained with the square one."""
    cells: tuple[str, ...]
    """Successes of tries at each hole pose."""
    is_on_arm: bool = False
    """True if it was trained on the robot."""


_ALL = ("20/20", "20/20", "20/20")

TRANSFER = (
    PaperRow("stack 0", 0, "square", _ALL),
    PaperRow("stack 4", STACK, "square", _ALL),
    PaperRow("stack 0, triangle", 0, "triangle", _ALL),
    PaperRow("stack 4, triangle", STACK, "triangle", ("18/20", "20/20", "19/20")),
    PaperRow("dynamics randomisation", None, "square", _ALL),
    PaperRow(
        "dynamics randomisation, triangle",
        None,
        "triangle",
        ("20/20", "20/20", "10/20"),
    ),
    PaperRow("trained on the arm, one pose", 0, "square", ("20/20",), is_on_arm=True),
)
"""The seven rows."""

ROBUSTNESS = {
    "shift": "worked up to 20 mm",
    "search": "",
    "push": "pushed by hand; no force and no rate given",
    "speed": "the hole moved during the episode; no rate given",
    "below": "starts below the surface; no rate given",
}
"""Statement of the paper about each test of robustness, on the real robot."""
