"""Shapely, which knows of areas in the plane: imported where it is needed."""

from collections.abc import Sequence
from typing import Any

from dovetail.errors import MissingDependencyError, install_command
from dovetail.types import Array


def import_shapely() -> Any:
    """Return the module shapely.

    Raises:
        MissingDependencyError: It is not installed.
    """
    try:
        import shapely
    except ImportError as error:
        raise MissingDependencyError(
            f"outlines need shapely, which is not installed: {install_command('parts')}"
        ) from error
    return shapely


def why_invalid(outer: Array, cutouts: Sequence[Array]) -> str:
    """Return why the lines around an area meet one another; empty if they do not."""
    shapely = import_shapely()
    area = shapely.Polygon(outer, cutouts)
    if shapely.is_valid(area):
        return ""
    return str(shapely.is_valid_reason(area)).lower()
