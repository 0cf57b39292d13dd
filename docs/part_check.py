"""Draw docs/part-check.png: a knob on a hexagon in its socket, and fingers on it."""

import sys
from pathlib import Path

import numpy as np
import trimesh

from dovetail.meshes.figures import draw_hold
from dovetail.meshes.hold import find_hold

ROOT = Path(__file__).parent.parent
DEPTH = 0.020  # [m]


def hexagon(*profile: tuple[float, float]) -> trimesh.Trimesh:
    """Revolve distances to the flats and heights [mm] in six steps."""
    corners = 1e-3 * np.array(profile) * [2.0 / np.sqrt(3.0), 1.0]
    return trimesh.creation.revolve(corners, sections=6)


def main(file: Path) -> None:
    """Draw both cuts and the view from above."""
    plug = hexagon((0, -20), (8, -20), (8, 4), (13, 4), (13, 16), (0, 16))
    socket = hexagon((0, -28), (25, -28), (25, 0), (8.3, 0), (8.3, -20), (0, -20))
    file.write_bytes(draw_hold(plug, socket, find_hold(plug, socket, DEPTH)))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else ROOT / "docs" / "part-check.png")
