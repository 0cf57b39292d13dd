"""Robot files that mean harm: each is one message, soon, and without much memory."""

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arm_files import urdf

from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.plants.mjcf import build_mjcf
from dovetail.robots.meshes import find_mesh, read_mesh
from dovetail.robots.robot import Robot

PROGRAM = Path(__file__).parent / "hostile_files.py"
SECONDS = 5.0
"""Most time of a processor for one file."""
BYTES = 1_000_000_000
SQUARE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 2 3 4\n"
VISUAL = '<visual><geometry><mesh filename="{}"/></geometry></visual>'


@pytest.mark.timeout(240)
def test_no_robot_file_hangs_eats_or_ends_the_command(tmp_path):
    """All in one process, as starting one takes longer than every file."""
    done = subprocess.run(
        [sys.executable, str(PROGRAM)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )
    assert "Traceback" not in done.stderr
    assert done.returncode == 0, done.stdout[-200:]
    said = [json.loads(line) for line in done.stdout.splitlines() if line[0] == "{"]
    ended = {line["name"]: line for line in said if "name" in line}
    assert len(ended) > 60
    for name, line in ended.items():
        assert line["code"] == (0 if line["is_loaded"] else 2), name
        assert line["seconds"] < SECONDS, name
        assert line["bytes"] < BYTES, name
    errors = [line for line in done.stderr.splitlines() if line.startswith("dovetail:")]
    assert len(errors) == sum(not line["is_loaded"] for line in ended.values())
    assert max(map(len, errors)) < 2000
    assert not [*tmp_path.glob("MUJOCO_LOG*")]


def with_visual(folder, name):
    text = urdf().replace('<link name="base"/>', f'<link name="base">{VISUAL}</link>')
    path = folder / "arm.urdf"
    path.write_text(text.format(name))
    return path


def drawn(path):
    """Return an arm, and the names of the meshes that its base is drawn as."""
    import mujoco

    robot = Robot.from_urdf(path)
    cell = replace(find_cell(), robot=robot)
    text = build_mjcf(cell.loaded_robot(), cell, visual_meshes=True)
    model = mujoco.MjModel.from_xml_string(text)
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "evil") < 0
    names = [model.mesh(i).name for i in range(model.nmesh)]
    return robot, [name for name in names if name.startswith("link0")]


INJECTED = '0"/></asset><worldbody><geom name="evil" size="1"/></worldbody><asset q="'
BAD = {
    "injected": SQUARE + f"v 0 0 {INJECTED}\n".encode(),
    "scattered": SQUARE.replace(b"v 1 0 0", b'v "/><x 0 0'),
    "no_index": SQUARE + b"f 1 2 99\n",
    "zero_index": SQUARE + b"f 0 1 2\n",
    "backwards": SQUARE + b"f -9 1 2\n",
    "digits": SQUARE + b"f 1 2 " + b"9" * 5000 + b"\n",
    "not_finite": SQUARE + b"v nan 0 0\n",
    "far": SQUARE + b"v 1e300 0 0\n",
    "flat": b"v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n",
    "empty": b"",
    "no_faces": b"v 0 0 0\n",
    "short": b"v 0 0\nf 1 1 1\n",
    "one_face": SQUARE + b"f " + b"1 2 " * 2_000_000,
    "vertices": b"v 1 1 1\n" * 1_000_000,
    "faces": SQUARE + b"f 1 2 3\n" * 1_000_000,
    "lines": b"#\n" * 9_000_000,
    "bytes": b"#" * 21_000_000,
}


@pytest.mark.parametrize("name", BAD)
def test_an_obj_that_cannot_be_drawn_is_left_out_and_said(name, tmp_path):
    (tmp_path / "x.obj").write_bytes(BAD[name])
    begin = time.process_time()
    robot, meshes = drawn(with_visual(tmp_path, "x.obj"))
    assert time.process_time() - begin < SECONDS
    assert robot.drawn[0] == ()
    assert len(robot.notes) == 1
    assert meshes == []


def test_a_large_obj_is_read_soon(tmp_path):
    """80 MB of text took over 60 s; what the limit admits takes a few."""
    rng = np.random.default_rng(0)
    file = tmp_path / "x.obj"
    rows = rng.normal(size=(100_000, 3)).tolist()
    text = "".join(f"v {x:.5f} {y:.5f} {z:.5f}\n" for x, y, z in rows)
    corners = rng.integers(1, 100_000, (199_000, 3)).tolist()
    file.write_text(text + "".join(f"f {a}//1 {b}//1 {c}//1\n" for a, b, c in corners))
    begin = time.process_time()
    assert len(read_mesh(file).faces) == 199_000
    assert time.process_time() - begin < SECONDS


def test_names_of_a_file_stay_names_in_the_scene(tmp_path):
    name = 'a" file="b<&\'.stl'
    rows = np.zeros(4, dtype=[("n", "<f4", 3), ("v", "<f4", 9), ("a", "<u2")])
    rows["v"] = np.random.default_rng(0).normal(size=(4, 9))
    head = b"\0" * 80 + (4).to_bytes(4, "little")
    (tmp_path / name).write_bytes(head + rows.tobytes())
    quoted = name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    robot, meshes = drawn(with_visual(tmp_path, quoted))
    assert robot.drawn[0][0].file.name == name
    assert len(meshes) == 1


@pytest.mark.parametrize(
    "name",
    [
        "../../x.obj",
        "file:///{}/x.obj",
        "package://../../x.obj",
        "package://a/../../../x.obj",
        "{}/x.obj",
        "package://..",
        "x.obj/../../../x.obj",
    ],
)
def test_a_mesh_elsewhere_is_not_read(name, tmp_path):
    (tmp_path / "x.obj").write_bytes(SQUARE)
    folder = tmp_path / "a" / "b" / "c"
    folder.mkdir(parents=True)
    with pytest.raises(ConfigError):
        find_mesh(name.format(tmp_path), folder / "arm.urdf")


def test_many_large_meshes_do_not_add_up(tmp_path):
    (tmp_path / "x.obj").write_bytes(BAD["vertices"] + b"#" * 11_000_000)
    path = with_visual(tmp_path, "x.obj")
    path.write_text(
        path.read_text().replace(VISUAL.format("x.obj"), VISUAL.format("x.obj") * 400)
    )
    begin = time.process_time()
    robot = Robot.from_urdf(path)
    assert time.process_time() - begin < SECONDS
    assert "400 meshes" in robot.notes[0]
