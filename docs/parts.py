"""Draw docs/parts.png: the parts of three example files over their sockets."""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from dovetail.envs.registered import find_cell
from dovetail.poses import Pose, quat_from_matrix, tool_down
from dovetail.view.renderer import CameraView, Renderer

ROOT = Path(__file__).parent.parent
NAMES = ("hexagon", "d_shaft", "keyed_plug")
SIDE = 400  # [pixels]


def looking_at(point: np.ndarray, away: np.ndarray) -> Pose:
    """Return a camera's pose: x to the right, y down, z towards a point [m]."""
    z = -away / np.linalg.norm(away)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return Pose(
        point + away, quat_from_matrix(np.stack([x, np.cross(z, x), z], axis=1))
    )


def main(file: Path) -> None:
    """Draw each pair from the same place, and put the pictures side by side."""
    pictures = []
    for name in NAMES:
        cell = find_cell("dovetail/Insert-v0", part=str(ROOT / f"examples/{name}.toml"))
        fixture = Pose(np.array([0.6, 0.0, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))
        tip = Pose(fixture.position + np.array([0.0, 0.0, 0.045]), tool_down(0.0))
        robot = cell.loaded_robot()
        q = robot.inverse_kinematics(tip, robot.posture("down"))
        camera = looking_at(
            fixture.position + np.array([0.0, 0.0, 0.03]), np.array([-0.1, -0.22, 0.24])
        )
        renderer = Renderer(cell, width=SIDE, height=SIDE, samples=4)
        view = CameraView(camera, (-0.25, 0.25, -0.25, 0.25))
        pictures.append(renderer.draw(q, fixture, view=view))
        renderer.close()
    Image.fromarray(np.hstack(pictures)).save(file)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else ROOT / "docs" / "parts.png")
