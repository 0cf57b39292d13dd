"""Frames of an arm's joints, its flange and its tool."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from dovetail.errors import ConfigError
from dovetail.robots.arrays import ArrayFacts
from dovetail.types import JOINTS, Array, Mat33, Vec3


@dataclass(frozen=True, kw_only=True, eq=False)
class Geometry(ArrayFacts):
    """Frames along the arm, each in the one before it."""

    shapes: ClassVar = {
        "origin_position": (7, 3),
        "origin_rotation": (7, 3, 3),
        "flange_position": (3,),
        "flange_rotation": (3, 3),
        "tool_position": (3,),
        "tool_rotation": (3, 3),
    }

    origin_position: Array
    """Joint origins in the parent link [m], shape (7, 3)."""
    origin_rotation: Array
    """Joint frames in the parent link at q = 0, shape (7, 3, 3)."""
    flange_position: Vec3
    """Flange in the link-7 frame [m], shape (3,)."""
    flange_rotation: Mat33 = field(default_factory=lambda: np.eye(3))
    """Flange axes in the link-7 frame, shape (3, 3)."""
    tool_position: Vec3 = field(default_factory=lambda: np.zeros(3))
    """TCP in the flange frame [m], shape (3,)."""
    tool_rotation: Mat33 = field(default_factory=lambda: np.eye(3))
    """TCP axes in the flange frame, shape (3, 3)."""

    def tool_in_link(self) -> tuple[Vec3, Mat33]:
        """Return the TCP in the link-7 frame: position [m] and axes."""
        R = self.flange_rotation
        return self.flange_position + R @ self.tool_position, R @ self.tool_rotation

    def __post_init__(self) -> None:
        """Refuse a matrix that is no rotation, by its joint."""
        super().__post_init__()
        rotations = [*zip(JOINTS, self.origin_rotation, strict=True)]
        rotations += [("flange", self.flange_rotation), ("tool", self.tool_rotation)]
        for name, R in rotations:
            if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
                raise ConfigError(f"rotation of {name} is no rotation: {R.tolist()}")
