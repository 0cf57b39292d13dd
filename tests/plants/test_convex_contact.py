"""Convex parts in contact: MuJoCo holds a flat face still, and hardly lets it in."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.plants.mjcf import build_mjcf
from extras import need
from plants.inserted import place_inserted

need("shapely")
EXAMPLES = Path(__file__).parent.parent.parent / "examples"
ENV = "dovetail/Insert-v0"


def flags(**settings):
    cell = find_cell(**settings)
    flag = ET.fromstring(build_mjcf(cell.loaded_robot(), cell)).find("option/flag")
    return flag.get("nativeccd"), flag.get("multiccd")


def test_only_cells_with_convex_parts_collide_in_several_points():
    assert flags() == ("disable", None)
    assert flags(peg="round") == flags(peg="triangle") == ("disable", None)
    assert flags(env_id=ENV) == ("enable", "enable")


@pytest.mark.parametrize("aside", [0.0, 60.0])
@pytest.mark.parametrize("name", ["hexagon", "d_shaft", "keyed_plug"])
def test_100_newton_press_an_inserted_plug_in_by_less_than_a_tenth_of_a_mm(name, aside):
    cell = find_cell(ENV, part=str(EXAMPLES / f"{name}.toml"))
    plant, tool = place_inserted(cell)
    plant.push(np.array([aside, 0.0, -100.0]))
    forces, heights = [], []
    for _ in range(120):
        plant.apply(np.zeros(7), 0.005)
        forces.append(plant.contact_force())
        heights.append(plant.tool_pose().position[2] - tool.position[2])
    late = np.array(forces[60:])
    assert np.linalg.norm(late.mean(axis=0)) == pytest.approx(
        np.hypot(100.0, aside), rel=0.2
    )
    assert late.std(axis=0).max() < 1.0
    assert min(heights) > -1e-4
    plant.close()
