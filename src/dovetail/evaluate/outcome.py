"""What is kept of one try: numbers for the table and the tool's path."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dovetail.types import Array


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of one try of a policy."""

    pose: int
    """Index of the fixture pose."""
    attempt: int
    """Number of the try at this pose, from 0."""
    seed: int
    """Seed of the environment's reset: start pose and noise."""
    success: bool
    """The task was done: the part, say, ended deep enough inside the fixture."""
    steps: int
    """Policy steps taken (50 ms each)."""
    depth: float
    """Insertion depth at the end [m]."""
    force_mean: float
    """Mean contact force over the cycles in contact [N]; 0 without contact, nan where
    the arm does not measure it, as the next two."""
    force_peak: float
    """Largest contact force in any control cycle [N]."""
    force_step: float
    """Largest mean over a policy step (50 ms) of the cycles' peak forces [N]."""
    contact_cycles: int
    """Control cycles in contact."""
    violations: int
    """Control cycles in which a measured value lay outside its limit."""
    path: Array
    """Tool position in the fixture's frame [m], shape (cycles, 3), z out of it."""
    stopped: str
    """Why the arm ended the try before its time, in a word; empty when it did not."""
    log: str
    """File name of the Episode log, or empty when none was kept."""
    tare: tuple[float, ...] = (0.0,) * 6
    """f* that held the weight before the try [m/s2, rad/s2]; 0 without a tare."""
    perturbation: Mapping[str, Any] = field(default_factory=dict)
    """What was drawn for this try, by name and unit; empty where nothing was."""

    stopped_text: str = ""
    """What the arm said when it ended the try: what it saw, and what to look at."""
    film_error: str = ""
    """Why the try's film is missing; empty when it is there or none was wanted."""

    def numbers(self) -> dict[str, Any]:
        """Return everything but the path, for JSON."""
        return {name: value for name, value in vars(self).items() if name != "path"}
