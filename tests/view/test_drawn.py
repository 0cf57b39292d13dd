"""Arm and gripper are drawn by meshes where these are, and move as without them."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.plants.mjcf import build_mjcf
from dovetail.robots import drawn as meshes
from dovetail.robots.meshes import find_mesh
from dovetail.robots.robot import Robot
from dovetail.view.cell_model import LAST_DRAWN, cell_spec
from dovetail.workcell.tool import wsg50
from extras import need


def panda():
    """A Panda, read from its URDF."""
    folder = Path(need("pybullet_data").getDataPath())
    names = [f"panda_joint{i}" for i in range(1, 8)]
    return Robot.from_urdf(
        folder / "franka_panda" / "panda.urdf", joints=names, flange="panda_link8"
    )


def compiled(cell, *, visual_meshes):
    text = build_mjcf(cell.loaded_robot(), cell, visual_meshes=visual_meshes)
    return mujoco.MjModel.from_xml_string(text)


def shown(model):
    """Corners of everything that is drawn as meshes, in the world at q = 0."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for geom in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH):
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        corners = model.mesh_vert[first : first + count]
        R = data.geom_xmat[geom].reshape(3, 3)
        yield int(geom), corners @ R.T + data.geom_xpos[geom]


def test_a_robot_of_a_urdf_is_drawn_by_its_meshes_where_they_are_in_the_file():
    pin = need("pinocchio")
    robot = panda()
    assert [len(parts) for parts in robot.drawn] == [1, 1, 1, 1, 1, 1, 1, 4]
    path = Path(need("pybullet_data").getDataPath()) / "franka_panda" / "panda.urdf"
    model = pin.buildModelFromUrdf(str(path))
    frames = pin.Data(model)
    pin.framesForwardKinematics(model, frames, np.zeros(model.nq))
    at = robot.geometry.origin_position[0], robot.geometry.origin_rotation[0]
    for i in range(1, 8):
        link = frames.oMf[model.getFrameId(f"panda_link{i}")]
        one = robot.drawn[i][0].seen_from(*at)
        np.testing.assert_allclose(one.position, link.translation, atol=1e-9)
        np.testing.assert_allclose(one.rotation, link.rotation, atol=1e-9)
        if i < 7:
            turn = at[1] @ robot.geometry.origin_rotation[i]
            at = at[0] + at[1] @ robot.geometry.origin_position[i], turn


def test_a_file_of_several_objects_is_drawn_whole():
    """MuJoCo reads the first one alone: of this link 250 triangles of 18327."""
    model = compiled(replace(find_cell(), robot=panda()), visual_meshes=True)
    assert model.mesh("link5_0").facenum[0] == 18327
    assert len(list(shown(model))) > 10


def test_the_gripper_is_drawn_where_it_collides():
    need("pybullet_data")
    cell = find_cell()
    model = cell_spec(cell).compile()
    hidden = {model.geom(i).name for i in range(model.ngeom)
              if model.geom_group[i] > LAST_DRAWN}  # fmt: skip
    assert hidden == {"gripper", "finger_left", "finger_right"}
    tool = {f"tool_{k}" for k in range(5)}
    names = {i: model.mesh(model.geom_dataid[i]).name for i, _ in shown(model)}
    assert tool <= set(names.values())
    corners = np.vstack([c for i, c in shown(model) if names[i] in tool])
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    flange = data.body("flange")
    seen = (corners - flange.xpos) @ flange.xmat.reshape(3, 3)
    boxes = np.vstack([part.corners() for part in cell.tool.primitives])
    np.testing.assert_allclose(np.ptp(seen, axis=0), np.ptp(boxes, axis=0), atol=1e-3)
    np.testing.assert_allclose(seen[:, 2].max(), boxes[:, 2].max(), atol=1e-4)


def test_what_is_drawn_weighs_nothing_and_moves_nothing():
    need("pybullet_data")
    cell = find_cell()
    ways = []
    for visual_meshes in (False, True):
        model = compiled(cell, visual_meshes=visual_meshes)
        data = mujoco.MjData(model)
        data.mocap_pos[0] = [0.6, 0.0, 0.1]
        data.qpos[:] = [0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.5]
        for _ in range(1000):  # it falls onto the table
            mujoco.mj_step(model, data)
        ways.append([data.qpos.copy(), data.qvel.copy(), model.body_mass.copy()])
    for one, other in zip(*ways, strict=True):
        np.testing.assert_array_equal(one, other)


def test_without_the_files_arm_and_gripper_are_plain_bodies(monkeypatch, tmp_path):
    monkeypatch.setattr(meshes.importlib.util, "find_spec", lambda name: None)
    assert wsg50(opening=0.03, reach=0.07).drawn == ()
    cell = replace(find_cell(), tool=wsg50(opening=0.03, reach=0.07))
    cell = replace(cell, robot=replace(cell.robot, drawn=((),) * 8))
    model = compiled(cell, visual_meshes=True)
    assert list(shown(model)) == []
    assert (model.geom_group <= LAST_DRAWN).all()


@pytest.mark.parametrize("name", ["package://gone/x.stl", "x.dae", "file:///gone.obj"])
def test_a_mesh_that_is_not_here_is_not_found(name, tmp_path):
    with pytest.raises(ConfigError):
        find_mesh(name, tmp_path / "arm.urdf")


def test_a_mesh_is_found_below_its_package_or_beside_the_urdf(tmp_path):
    file = tmp_path / "arm_description" / "meshes" / "x.STL"
    file.parent.mkdir(parents=True)
    file.touch()
    urdf = tmp_path / "arm_description" / "urdf" / "arm.urdf"
    urdf.parent.mkdir()
    for name in ("package://arm_description/meshes/x.STL", "../meshes/x.STL"):
        assert find_mesh(name, urdf) == file


def test_what_a_urdf_says_in_short_or_cannot_be_drawn_is_no_refusal(tmp_path):
    """A scale of one number and a colour of three ended the reading of the arm."""
    square = np.zeros(1, dtype=[("n", "<f4", 3), ("v", "<f4", 9), ("a", "<u2")])
    square["v"] = [0, 0, 0, 1, 0, 0, 0, 1, 0]
    head = b"\0" * 80 + (1).to_bytes(4, "little")
    (tmp_path / "good.stl").write_bytes(head + square.tobytes())
    (tmp_path / "text.stl").write_text("solid a\nendsolid a\n")
    (tmp_path / "bad.obj").write_text("v 0 0 0\nf 1 x 2\n")
    visual = '<visual><geometry><mesh filename="{}" scale="0.001"/></geometry></visual>'
    files = "".join(visual.format(f) for f in ("good.stl", "text.stl", "bad.obj"))
    colour = '<material name="grey"><color rgba="1 1 1"/></material>'
    text = f'<robot name="r">{colour}<link name="a">{files}</link></robot>'
    found, (note,) = meshes.read_drawn(ET.fromstring(text), tmp_path / "r.urdf")
    (only,) = found["a"]
    assert note.startswith("r.urdf: 2 meshes are not drawn; the first is text.stl")
    assert only.file.name == "good.stl"
    assert only.scale == (0.001, 0.001, 0.001)
