"""Pairs of meshes in MuJoCo: the plug stops where the meshes meet, and no deeper."""

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.meshes.pair import convert
from dovetail.meshes.part_folder import write_part
from extras import need
from meshes.solids import mesh
from meshes.test_pair import cone_pair, square_pair, stepped_pair
from plants.inserted import place_inserted

need("shapely")
need("trimesh")
need("manifold3d")


def sink(part, force):
    """Press the plug down from where it stands in the end; return how far it goes."""
    cell = find_cell("dovetail/Insert-v0", part=str(part))
    plant, tool = place_inserted(cell)
    plant.push(np.array([0.0, 0.0, -force]))
    heights = []
    for _ in range(200):
        plant.apply(np.zeros(7), 0.005)
        heights.append(plant.tool_pose().position[2] - tool.position[2])
    plant.close()
    return -float(np.mean(heights[-40:])), -min(heights)


@pytest.mark.parametrize("pair", [square_pair, stepped_pair, cone_pair])
def test_a_plug_stops_where_the_meshes_meet(pair, tmp_path):
    found = convert(*(mesh(body) for body in pair()))
    part = write_part(found, tmp_path)
    assert found.exactness is not None
    way = found.exactness.stop_mesh
    assert way is not None
    light, _ = sink(part, 5.0)
    assert light == pytest.approx(way, abs=1e-4)
    heavy, deepest = sink(part, 100.0)
    assert heavy < way + 1e-4
    assert deepest < way + 2e-4
