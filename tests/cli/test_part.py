"""`dovetail part`: two meshes in, a part that train takes out, or a refusal."""

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest

from extras import need

trimesh = need("trimesh")
need("shapely")

from dovetail.cli import run  # noqa: E402
from dovetail.interrupt import INTERRUPTED  # noqa: E402
from dovetail.tasks.insert.task import Insert  # noqa: E402
from dovetail.workcell.part_file import read_pair  # noqa: E402
from dovetail.workcell.part_text import whole_part  # noqa: E402

ACROSS, GAP, DEPTH, LENGTH = 16.0, 0.3, 20.0, 60.0
"""Hexagon and its socket [mm]: width across flats, gap, depth and length."""


def hexagon(profile):
    """Revolve a profile of distances to the flats and heights [mm] in six steps."""
    corners = np.array(profile, float) * [2.0 / np.sqrt(3.0), 1.0]
    return trimesh.creation.revolve(corners, sections=6)


def plug(length=LENGTH):
    half = ACROSS / 2.0
    top = length - DEPTH
    return hexagon([(0, -DEPTH), (half, -DEPTH), (half, top), (0, top)])


def socket():
    hole, block = ACROSS / 2.0 + GAP, 25.0
    low = -DEPTH - 8.0
    return hexagon(
        [(0, low), (block, low), (block, 0), (hole, 0), (hole, -DEPTH), (0, -DEPTH)]
    )


@pytest.fixture
def pair(tmp_path, monkeypatch):
    """Both files in the current folder."""
    monkeypatch.chdir(tmp_path)
    plug().export("plug.stl")
    socket().export("socket.stl")


def check(*words):
    return run(["part", "check", *words])


def left():
    """What there is beside the meshes."""
    return sorted(p.name for p in Path().iterdir() if p.suffix not in (".stl", ".ply"))


def test_a_hexagon_becomes_a_part_that_the_task_takes(pair, capsys):
    assert check("plug.stl", "socket.stl", "--out", "out") == 0
    assert left() == ["out"]
    names = {path.name for path in Path("out").iterdir()}
    assert names == {
        *("part.toml", "plug.toml", "socket.toml"),
        *("report.html", "report.json"),
    }
    task = Insert(part="out/part.toml")
    assert task.clearance == pytest.approx(1e-3 * GAP, abs=2e-6)
    assert task.depths()[0] == pytest.approx(1e-3 * DEPTH, abs=1e-6)
    said = capsys.readouterr().out
    assert "dovetail evaluate insert_any --part out/part.toml" in said
    assert "dovetail train --part out/part.toml" in said
    worst = 1e3 * json.loads(Path("out/report.json").read_text())["exactness"]["worst"]
    assert f"worst {worst:.3f}" in " ".join(said.split())


def test_the_facts_are_those_of_the_hexagon(pair):
    check("plug.stl", "socket.stl", "--density", "2700", "--out", "out")
    facts = json.loads(Path("out/report.json").read_text())
    assert facts["go"]
    assert facts["axis"] == "-z"
    assert facts["plug"]["units_from"] == "guessed"
    assert facts["plug"]["was_closed"]
    assert facts["through"] is False
    area = np.sqrt(3.0) / 2.0 * ACROSS**2  # [mm2]
    assert facts["mass"] == pytest.approx(2700e-9 * area * LENGTH, rel=1e-4)
    assert facts["gap"]["quartiles"] == pytest.approx([1e-3 * GAP] * 3, abs=5e-6)
    assert facts["gap"]["least"] == pytest.approx(1e-3 * GAP, abs=5e-6)
    assert facts["hold"]["kind"] == "fingers"
    assert facts["hold"]["width"] == pytest.approx(1e-3 * ACROSS, abs=1e-5)


def test_the_tightest_place_is_told_where_the_files_have_it(pair):
    moved_files(trimesh.transformations.translation_matrix([100.0, -50.0, 300.0]))
    check("plug.stl", "socket.stl", "--out", "out")
    gap = json.loads(Path("out/report.json").read_text())["gap"]
    x, y, z = 1e3 * np.array(gap["at"]) - [100.0, -50.0, 300.0]
    assert -DEPTH <= z <= 0.0
    assert ACROSS / 2.0 - 1e-3 <= np.hypot(x, y) <= ACROSS / 2.0 * 1.2


def moved_files(matrix):
    for name in ("plug.stl", "socket.stl"):
        body = trimesh.load(name)
        body.apply_transform(matrix)
        body.export(name)


def test_the_parts_frame_is_told_in_the_files_axes(pair):
    # About +y: what went in along -z goes in along -x, and x is the files' -z.
    matrix = trimesh.transformations.rotation_matrix(np.pi / 2.0, [0.0, 1.0, 0.0])
    matrix[:3, 3] = 100.0, -50.0, 300.0
    moved_files(matrix)
    check("plug.stl", "socket.stl", "--out", "out")
    facts = json.loads(Path("out/report.json").read_text())
    assert facts["axis"] == "-x"
    frame = facts["frame"]
    assert 1e3 * np.array(frame["origin"]) == pytest.approx([100.0, -50.0, 300.0])
    np.testing.assert_allclose(frame["z"], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(frame["x"], [0.0, 0.0, -1.0], atol=1e-12)


def test_a_hold_across_the_simulations_fingers_says_how_to_turn_the_files(pair, capsys):
    moved_files(trimesh.transformations.rotation_matrix(np.radians(-80.0), [0, 0, 1]))
    check("plug.stl", "socket.stl", "--out", "out")
    turn = np.degrees(json.loads(Path("out/report.json").read_text())["hold"]["turn"])
    assert turn == pytest.approx(130.0, abs=0.1)  # across two faces of the hexagon
    said = " ".join(capsys.readouterr().out.split())
    assert "turn both files by 50 deg" in said


def test_a_part_is_named_after_its_folder(pair):
    check("plug.stl", "socket.stl", "--out", "knob")
    assert Insert(part="knob/part.toml").describe()[0] == "knob"


def test_a_plug_above_its_floor_is_said_to_be(pair, capsys):
    body = plug()
    body.apply_translation([0.0, 0.0, 1.5])
    body.export("plug.stl")
    check("plug.stl", "socket.stl", "--out", "out")
    said = " ".join(capsys.readouterr().out.split())
    assert "18.50 mm below the mouth" in said
    assert "stands 1.50 mm above where the socket stops it" in said


def test_a_large_plug_that_is_no_go_asks_for_the_unit_first(pair):
    for name in ("plug.stl", "socket.stl"):
        body = trimesh.load(name)
        body.apply_scale(4.0)
        body.export(name)
    assert check("plug.stl", "socket.stl", "--units", "mm", "--out", "out") == 1
    first, *others = json.loads(Path("out/report.json").read_text())["problems"]
    assert "--units" in first
    assert others


def test_the_report_needs_no_other_file(pair):
    check("plug.stl", "socket.stl", "--out", "out")
    page = Path("out/report.html").read_text()
    assert page.count(' src="data:image/png;base64,') == 3
    assert ' src="http' not in page
    assert "<script src=" not in page


def test_a_plug_that_is_too_heavy_is_no_go(pair):
    plug(length=80.0).export("plug.stl")
    assert check("plug.stl", "socket.stl", "--density", "25000", "--out", "out") == 1
    facts = json.loads(Path("out/report.json").read_text())
    assert facts["go"] is False
    assert len(facts["problems"]) == 1
    assert Path("out/report.html").exists()


def test_a_plug_that_is_taller_than_the_tool_is_held_lower(pair):
    plug(length=140.0).export("plug.stl")
    assert check("plug.stl", "socket.stl", "--out", "out") == 0
    part = read_pair(whole_part("out/part.toml"))
    assert -part.held.corners[:, 2].min() <= 0.110


def test_a_flush_plug_gets_a_stalk(pair):
    plug(length=DEPTH).export("plug.stl")
    assert check("plug.stl", "socket.stl", "--out", "out") == 0
    hold = json.loads(Path("out/report.json").read_text())["hold"]
    assert hold["kind"] == "stalk"
    assert hold["reach"] == pytest.approx(1e-3 * DEPTH)
    assert hold["fingers_alone"] < 1e-3 * DEPTH - 0.002


def test_swapped_files_go_in_the_other_way(pair):
    check("socket.stl", "plug.stl", "--out", "out")
    assert json.loads(Path("out/report.json").read_text())["axis"] == "+z"


def remove():
    Path("plug.stl").unlink()
    return "plug.stl", "socket.stl"


def fill_with_garbage():
    Path("plug.stl").write_bytes(np.random.default_rng(0).bytes(4000))
    return "plug.stl", "socket.stl"


def open_up():
    mesh = plug()
    mesh.update_faces(np.abs(mesh.face_normals[:, 2]) < 0.5)
    mesh.export("plug.stl")
    return "plug.stl", "socket.stl"


def take_for_metres():
    return "plug.stl", "socket.stl", "--units", "m"


def swap_with_an_axis():
    return "socket.stl", "plug.stl", "--axis", "-z"


def move_apart():
    plug().apply_translation([200.0, 0.0, 0.0]).export("plug.stl")
    return "plug.stl", "socket.stl"


def make_too_large():
    plug().apply_scale([1.1, 1.1, 1.0]).export("plug.stl")
    return "plug.stl", "socket.stl"


def name_a_drawing():
    Path("plug.step").touch()
    return "plug.step", "socket.stl"


def add_a_body():
    other = plug()
    other.apply_translation([60.0, 0.0, 0.0])
    trimesh.util.concatenate([plug(), other]).export("plug.stl")
    return "plug.stl", "socket.stl"


def undercut():
    """A foot below a narrower mouth."""
    low, half, hole = -DEPTH - 8.0, ACROSS / 2.0, ACROSS / 2.0 + GAP
    foot = [(0, -DEPTH), (half + 4.0, -DEPTH), (half + 4.0, -15.0), (half, -15.0)]
    hexagon([*foot, (half, 40.0), (0, 40.0)]).export("plug.stl")
    room = [(hole, 0), (hole, -14.0), (hole + 4.5, -14.0), (hole + 4.5, -DEPTH)]
    block = [(0, low), (25.0, low), (25.0, 0)]
    hexagon([*block, *room, (0, -DEPTH)]).export("socket.stl")
    return "plug.stl", "socket.stl"


REFUSED = (
    *(remove, fill_with_garbage, open_up, take_for_metres, swap_with_an_axis),
    *(move_apart, make_too_large, name_a_drawing, add_a_body, undercut),
)


@pytest.mark.parametrize("spoil", REFUSED)
def test_a_wrong_file_is_refused_and_nothing_is_written(spoil, pair, capsys):
    words = spoil()
    before = left()
    assert check(*words, "--out", "new/out") == 2
    assert left() == before
    said = capsys.readouterr()
    assert said.err.startswith("dovetail: ")
    assert said.out == ""


def test_a_folder_that_holds_something_is_refused(pair):
    Path("out").mkdir()
    Path("out/mine.txt").touch()
    assert check("plug.stl", "socket.stl", "--out", "out") == 2
    assert [path.name for path in Path("out").iterdir()] == ["mine.txt"]


@pytest.mark.parametrize("out", [".", "../link"])
def test_an_empty_folder_that_is_there_is_filled(out, pair, tmp_path, monkeypatch):
    here = tmp_path / "here"
    here.mkdir()
    (tmp_path / "link").symlink_to(here)
    monkeypatch.chdir(here)
    assert check("../plug.stl", "../socket.stl", "--out", out) == 0
    names = ["part.toml", "plug.toml", "report.html", "report.json", "socket.toml"]
    assert sorted(path.name for path in here.iterdir()) == names


def test_a_full_disk_is_said_and_leaves_nothing(pair, monkeypatch, capsys):
    def fill(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("shutil.copyfile", fill)
    assert check("plug.stl", "socket.stl", "--out", "out") == 2
    assert os.strerror(errno.ENOSPC) in capsys.readouterr().err
    assert left() == []


@pytest.mark.parametrize("where", ["report.to_html", "pair.convert"])
def test_ctrl_c_leaves_nothing(where, pair, monkeypatch):
    def press(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"dovetail.meshes.{where}", press)
    assert check("plug.stl", "socket.stl", "--out", "out") == INTERRUPTED
    assert left() == []


def test_show_says_what_a_part_file_makes(tmp_path, capsys):
    file = tmp_path / "part.toml"
    file.write_text(
        'units = "mm"\noutline = "square 10"\nlength = 50\ndepth = 15\ngap = 0.2\n'
    )
    assert run(["part", "show", str(file)]) == 0
    said = capsys.readouterr().out
    assert "0.2 mm" in said
    assert "15 mm" in said
    mass = 10.0 * 10.0 * 50.0 * 2700e-9  # [kg]
    assert f"{1e3 * mass:.3g} g" in said
    file.write_text('units = "mm"\n')
    assert run(["part", "show", str(file)]) == 2
