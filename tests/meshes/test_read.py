"""Meshes of strangers: read, repaired and said so, or refused."""

import re
import struct
import time
import zipfile

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.meshes import read
from dovetail.meshes.read import read_mesh, read_meshes
from extras import need
from meshes.solids import circle, prism, square

need("trimesh")
need("manifold3d")


def box(size=20.0):
    return need("trimesh").creation.box((size, size / 2, size / 4))


def save(body, path):
    body.export(path)
    return path


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "3mf"])
def test_each_format_has_the_same_body(tmp_path, ending):
    found = read_mesh(save(box(), tmp_path / f"a.{ending}"), units="mm")
    assert found.volume == pytest.approx(20e-3 * 10e-3 * 5e-3)
    assert found.was_closed
    assert found.centre == pytest.approx(np.zeros(3), abs=1e-9)
    assert found.units_from == "given"


def test_an_stl_of_text_is_read(tmp_path):
    path = tmp_path / "a.stl"
    box().export(path, file_type="stl_ascii")
    assert read_mesh(path, "mm").volume == pytest.approx(1e-6)


@pytest.mark.parametrize(
    ("size", "units"), [(0.02, "m"), (20.0, "mm"), (0.8, "inch"), (90.0, "mm")]
)
def test_a_unit_is_guessed_by_the_size_and_said(tmp_path, size, units):
    found = read_mesh(save(box(size), tmp_path / "a.stl"))
    assert (found.units, found.units_from) == (units, "guessed")
    assert any(units in note for note in found.notes)


def test_both_meshes_of_a_pair_have_one_unit(tmp_path):
    """The small one alone would be taken for inches."""
    small, large = save(box(2.0 * 2), tmp_path / "a.stl"), tmp_path / "b.stl"
    small = save(box(2.5), tmp_path / "a.stl")
    with pytest.raises(ConfigError):  # 2.5 mm is no part
        read_meshes(small, save(box(40.0), large))
    small = save(box(4.0), tmp_path / "a.stl")
    one, other = read_meshes(small, large)
    assert one.units == other.units == "mm"
    assert "the other part's longest side is 40," in one.notes[0]
    assert "its longest side is 40," in other.notes[0]


def test_a_guess_names_the_size_in_the_other_units(tmp_path):
    """A plug of 28 mm from a file in cm is taken for 71 mm, which a person sees."""
    found = read_mesh(save(box(2.8), tmp_path / "a.stl"))
    assert found.units == "inch"
    assert "71.1 mm" in found.notes[0]
    assert "28 mm if they are cm" in found.notes[0]


def three_mf(body, folder, unit):
    """Save a body as a 3MF that says this unit."""
    path, other = save(body, folder / "mm.3mf"), folder / "unit.3mf"
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(other, "w") as new:
        for name in archive.namelist():
            text = archive.read(name)
            if name.endswith(".model"):
                text = re.sub(rb'unit="[a-z]*"', b'unit="%s"' % unit.encode(), text)
                assert unit.encode() in text
            new.writestr(name, text)
    return other


@pytest.mark.parametrize(
    ("unit", "longest"),
    [("micron", 20e3), ("millimeter", 20.0), ("foot", 20.0 / 304.8)],
)
def test_each_unit_of_a_3mf_is_taken(tmp_path, unit, longest):
    found = read_mesh(three_mf(box(longest), tmp_path, unit))
    assert found.units_from == "file"
    assert np.ptp(found.vertices[:, 0]) == pytest.approx(20e-3)


def test_a_unit_that_is_given_is_taken_in_place_of_the_files(tmp_path):
    found = read_mesh(three_mf(box(2.0), tmp_path, "foot"), "cm")
    assert np.ptp(found.vertices[:, 0]) == pytest.approx(20e-3)


def test_a_body_with_two_materials_is_one(tmp_path):
    path = save(box(), tmp_path / "a.obj")
    lines = path.read_text().splitlines()
    faces = [i for i, line in enumerate(lines) if line.startswith("f ")]
    lines.insert(faces[5], "usemtl second")
    lines.insert(faces[0], "usemtl first")
    path.write_text("\n".join(lines))
    assert read_mesh(path, "mm").volume == pytest.approx(1e-6)


@pytest.mark.parametrize("content", [b"", b"this is no mesh", b"solid a\nendsolid"])
def test_a_file_without_triangles_is_no_mesh(tmp_path, content):
    path = tmp_path / "a.stl"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"no triangles|no STL"):
        read_mesh(path)


def test_one_file_is_not_both_parts(tmp_path):
    path = save(box(), tmp_path / "a.stl")
    with pytest.raises(ConfigError, match="same file"):
        read_meshes(path, path)


@pytest.mark.parametrize("ending", ["obj", "ply"])
def test_corners_of_no_triangle_say_nothing_of_the_size(tmp_path, ending):
    body = box()
    corners = np.vstack([body.vertices, [1000.0, 0.0, 0.0]])
    stray = need("trimesh").Trimesh(corners, body.faces, process=False)
    found = read_mesh(save(stray, tmp_path / f"a.{ending}"))
    assert found.units == "mm"
    assert np.ptp(found.vertices, axis=0) == pytest.approx([0.02, 0.01, 0.005])


@pytest.mark.parametrize(("size", "units"), [(20.0, "m"), (20.0, "inch"), (0.02, "mm")])
def test_a_size_that_no_part_has_is_refused(tmp_path, size, units):
    with pytest.raises(ConfigError) as error:
        read_mesh(save(box(size), tmp_path / "a.stl"), units)
    assert error.value.name == "units"
    assert error.value.allowed == read.SIZE_RANGE


def test_a_body_that_is_inside_out_is_turned_and_said(tmp_path):
    body = box()
    body.invert()
    found = read_mesh(save(body, tmp_path / "a.stl"), "mm")
    assert found.volume == pytest.approx(1e-6)
    assert any("inside out" in note for note in found.notes)


def test_triangles_that_are_turned_are_turned_back(tmp_path):
    body = box()
    body.faces[[1, 4]] = body.faces[[1, 4]][:, ::-1]
    found = read_mesh(save(body, tmp_path / "a.stl"), "mm")
    assert found.volume == pytest.approx(1e-6)
    assert any("2 triangles turned" in note for note in found.notes)


def test_an_open_body_is_refused(tmp_path):
    body = box()
    body.update_faces(np.arange(len(body.faces)) > 1)
    with pytest.raises(ConfigError, match="not closed") as error:
        read_mesh(save(body, tmp_path / "a.stl"), "mm")
    assert error.value.value == 4  # edges


def test_a_small_hole_is_closed_and_said(tmp_path):
    body = prism(circle(10.0, sides=200), 0.0, 20.0)
    lengths = body.area_faces
    body.update_faces(np.arange(len(body.faces)) != int(lengths.argmin()))
    found = read_mesh(save(body, tmp_path / "a.stl"), "mm")
    assert not found.was_closed
    assert found.volume == pytest.approx(1e-9 * np.pi * 100 * 20, rel=1e-3)
    assert any("opening" in note for note in found.notes)


def test_corners_on_a_neighbours_edge_close_it(tmp_path):
    """One side's triangles are halved, their neighbours' are not."""
    body = box()
    vertices, faces = body.vertices, body.faces.tolist()
    a, b, c = faces.pop(0)
    middle = len(vertices)
    vertices = np.vstack([vertices, (vertices[a] + vertices[b]) / 2.0])
    new = need("trimesh").Trimesh(
        vertices, [*faces, (a, middle, c), (middle, b, c)], process=False
    )
    found = read_mesh(save(new, tmp_path / "a.stl"), "mm")
    assert not found.was_closed
    assert found.volume == pytest.approx(1e-6)


def test_two_bodies_are_refused(tmp_path):
    other = box()
    other.apply_translation([40.0, 0.0, 0.0])
    both = need("trimesh").util.concatenate([box(), other])
    with pytest.raises(ConfigError) as error:
        read_mesh(save(both, tmp_path / "a.stl"), "mm")
    assert error.value.value == 2


def test_a_scene_is_refused(tmp_path):
    scene = need("trimesh").Scene([box(), box(30.0)])
    with pytest.raises(ConfigError) as error:
        read_mesh(save(scene, tmp_path / "a.3mf"))
    assert error.value.value == 2


def test_a_hole_inside_a_body_is_no_other_body(tmp_path):
    inner = box(10.0)
    inner.invert()
    both = need("trimesh").util.concatenate([box(), inner])
    found = read_mesh(save(both, tmp_path / "a.stl"), "mm")
    assert found.volume == pytest.approx(1e-6 * 7 / 8)


def test_nothing_else_is_opened(tmp_path, monkeypatch):
    """Neither the materials that an OBJ names, nor their textures."""
    path = save(box(), tmp_path / "a.obj")
    text = path.read_text()
    (tmp_path / "m.mtl").write_text("newmtl red\nmap_Kd t.png\n")
    names = '"/><option timestep="9"/>'
    path.write_text(f"mtllib m.mtl\no {names}\ng {names}\nusemtl red\n{text}")
    opened = []
    monkeypatch.setattr(
        "builtins.open",
        lambda *a, **k: opened.append(a) or (_ for _ in ()).throw(OSError()),
    )
    found = read_mesh(path, "mm")
    monkeypatch.undo()
    assert found.volume == pytest.approx(1e-6)
    assert not opened
    assert names not in repr(found._replace(vertices=None, faces=None))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", b""),
        ("a.stl", b"solid x\nfacet normal nan nan nan\n"),
        ("a.stl", bytes(80) + struct.pack("<I", 4_000_000_000)),
        ("a.obj", b"v nan nan nan\nv 0 0 1\nv 0 1 0\nv 1 0 0\nf 1 2 3\nf 1 2 4\n"),
        ("a.obj", b"f 1 2 999999999\n"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -9\n"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n"),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
            b"property float y\nproperty float z\nelement face 1\n"
            b"property list uchar int vertex_indices\nend_header\n"
            b"0 0 0\n9 0 0\n0 9 0\n3 0 1 7\n",
        ),
        ("a.3mf", b"PK\x03\x04"),
        ("a.step", b"ISO-10303-21;"),
    ],
)
def test_damaged_files_are_refused(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    start = time.monotonic()
    with pytest.raises(ConfigError):
        read_mesh(path, "mm")
    assert time.monotonic() - start < 20.0


def test_too_many_triangles_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(read, "MAX_TRIANGLES", 11)
    with pytest.raises(ConfigError) as error:
        read_mesh(save(box(), tmp_path / "a.stl"), "mm")
    assert error.value.value == 12


def test_an_archive_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(read, "MAX_BYTES", 1_000_000)
    path = tmp_path / "a.3mf"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", bytes(5_000_000))
    with pytest.raises(ConfigError) as error:
        read_mesh(path)
    assert error.value.value == 5_000_000


def rewritten(tmp_path, change):
    """The 3MF of a box, its model changed."""
    good, path = save(box(), tmp_path / "good.3mf"), tmp_path / "a.3mf"
    with zipfile.ZipFile(good) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            new.writestr(name, change(content) if ".model" in name else content)
    return path


@pytest.mark.parametrize("coding", ["utf-8", "utf-16"])
def test_a_body_that_is_placed_many_times_is_refused_at_once(tmp_path, coding):
    def place_often(model):
        text = model.decode()
        item = text[text.index("<item") : text.index("</build>")]
        return text.replace(item, 30_000 * item).replace("utf-8", coding).encode(coding)

    start = time.monotonic()
    with pytest.raises(ConfigError) as error:
        read_mesh(rewritten(tmp_path, place_often))
    assert error.value.value == 30_000
    assert time.monotonic() - start < 10.0


def test_a_document_type_is_refused_in_any_coding(tmp_path):
    def declare(model):
        text = model.decode().replace("utf-8", "utf-16")
        return text.replace("<model", "<!DOCTYPE model>\n<model", 1).encode("utf-16")

    with pytest.raises(ConfigError, match="document type"):
        read_mesh(rewritten(tmp_path, declare))


def test_an_archive_with_damaged_bytes_is_refused(tmp_path):
    path = tmp_path / "a.3mf"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", bytes(range(256)) * 40)
    content = bytearray(path.read_bytes())
    content[50:90] = bytes(40 * [0xFF])
    path.write_bytes(content)
    with pytest.raises(ConfigError) as error:
        read_mesh(path)
    assert error.value.name == "mesh"


def test_a_flat_sheet_encloses_nothing(tmp_path):
    trimesh = need("trimesh")
    corners = [[0, 0, 0], [20, 0, 0], [20, 20, 0], [0, 20, 0]]
    faces = [[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]]
    sheet = trimesh.Trimesh(corners, faces, process=False)
    with pytest.raises(ConfigError):
        read_mesh(save(sheet, tmp_path / "a.stl"), "mm")


def test_an_area_in_mm_is_as_large_as_it_is(tmp_path):
    body = prism(square(20.0), 0.0, 10.0)
    found = read_mesh(save(body, tmp_path / "a.stl"), "mm")
    assert found.volume == pytest.approx(4e-6)


def test_a_flat_face_with_folded_triangles_is_made_anew(tmp_path):
    """A top whose triangles overlap one another, as some exporters write them."""
    trimesh = need("trimesh")
    body = prism(circle(10.0, sides=12), 0.0, 20.0)
    top = (body.vertices[body.faces][:, :, 2] > 19.99).all(axis=1)
    rim = np.unique(body.faces[top])
    a, b, c, d = rim[:4]
    folded = [*body.faces[~top], *body.faces[top], (a, b, c), (a, c, d), (b, c, d)]
    new = trimesh.Trimesh(body.vertices, folded, process=False)
    found = read_mesh(save(new, tmp_path / "a.obj"), "mm")
    assert not found.was_closed
    assert found.volume == pytest.approx(1e-9 * body.volume, rel=1e-6)
