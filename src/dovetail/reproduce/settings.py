"""A stage's settings, flat and in the paper's words, as those of a run."""

from collections.abc import Mapping
from typing import Any

from dovetail.reproduce.stage import with_tuples
from dovetail.tasks.options import gather_options
from dovetail.tasks.peg_in_hole.task import PegInHole

_FIELDS = {
    "hole": "fixture",
    "hole_shift": "fixture_shift",
    "hole_speed": "fixture_speed",
}
"""Words of the stages, which a results folder holds, and the fields that they are."""


def as_config(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return a stage's settings as a training or an evaluation takes them."""
    given = gather_options(with_tuples(settings), PegInHole)
    return {_FIELDS.get(name, name): value for name, value in given.items()}
