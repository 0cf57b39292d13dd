"""Robot files that would hang, eat the machine, or read what is not theirs.

Run as a program in a folder it writes the files there, and gives each of them to
`dovetail demo --robot`. For each it prints a line of JSON.
"""

import itertools
import json
import os
import sys
import time
from pathlib import Path

from arm_files import mjcf, urdf

SPHERE = '<geom size="0.1"/>'
MESH = '<geom type="mesh" mesh="m"/>'
NAMES = itertools.pairwise("abcdefghi")
LAUGHS = '<!DOCTYPE r [<!ENTITY a "ha">{}]>'.format(
    "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in NAMES)
)


def peak_bytes():
    """Most memory since this program began; getrusage counts what started it, too."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return 1024 * int(line.split()[1])
    raise OSError("no VmHWM in /proc/self/status")


def chain(count):
    """That many links in a row."""
    return "".join(
        f'<link name="c{i}"/><joint name="k{i}" type="fixed"><parent link='
        f'"{f"c{i - 1}" if i else "part7"}"/><child link="c{i}"/></joint>'
        for i in range(count)
    )


def with_mesh(file, content=None, folder=None):
    """An arm that needs a mesh for its mass."""
    if content is not None:
        (folder / file).write_bytes(content)
    top = f'<asset><mesh name="m" file="{file}"/></asset>'
    return mjcf(top=top, body=MESH, inertial=False)


def link_to(path, target):
    path.symlink_to(target)


def urdf_files():
    """Texts of URDF files that must be refused."""
    good = urdf()
    return {
        "laughs": LAUGHS + good.replace("part1", "&i;"),
        "external": '<!DOCTYPE r [<!ENTITY e SYSTEM "/dev/zero">]>' + good,
        "deep": "<robot>" + "<a>" * 200_000 + "</a>" * 200_000 + "</robot>",
        "many": "<robot>" + "<a/>" * 900_000 + "</robot>",
        "digits": urdf(effort="1" * 1_000_000),
        "nan": urdf(effort="nan"),
        "infinite": urdf(inertia=("inf", 1, 1)),
        "huge": urdf(inertia=("1e400", 1, 1)),
        "negative": urdf(inertia=(-1, 1, 1)),
        "own_parent": good.replace('parent link="base"', 'parent link="part1"'),
        "loop": good.replace('parent link="base"', 'parent link="part7"'),
        "two_roots": good.replace("</robot>", '<link name="other"/></robot>'),
        "unknown_link": good.replace('child link="part7"', 'child link="hand"'),
        "twice": urdf(extra='<link name="part7"/>'),
        "long_chain": urdf(extra=chain(300)),
        "long_name": good.replace("axis3", "x" * 1_000_000).replace("0.02", "-1"),
        "xacro": urdf(extra='<xacro:include filename="$(find x)/y"/>'),
        "zero_axis": good.replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"'),
        "planar": urdf(kind="planar"),
        "floating": urdf(kind="floating"),
        "strange_kind": urdf(kind="telescope"),
        "reversed": urdf(lower=2.5, upper=-2.5),
        "no_speed": urdf(velocity=0),
        "mimic": urdf(inside='<mimic joint="axis2"/>'),
        "damped": urdf(inside='<dynamics damping="-3"/>'),
        "encoding": '<?xml version="1.0" encoding="bz2"?>' + good,
        "cut": good[:700],
        "empty": "",
        "ascii_bell": good.replace("axis3", "axis3\x07"),
    }


def mjcf_files(folder):
    """Texts of MJCF files that must be refused."""
    link_to(folder / "zero.xml", "/dev/zero")
    (folder / "ring.xml").write_text('<mujoco><include file="ring2.xml"/></mujoco>')
    (folder / "ring2.xml").write_text('<mujoco><include file="ring.xml"/></mujoco>')
    for i in range(40):
        inner = f'<mujocoinclude><include file="row{i + 1}.xml"/></mujocoinclude>'
        (folder / f"row{i}.xml").write_text(inner)
    return {
        "replicate": mjcf(
            body=f'<replicate count="1000000000"><body>{SPHERE}</body></replicate>'
        ),
        "composite": mjcf(
            body='<composite type="cable" count="1000000 1 1" size="1"/>'
        ),
        "flexcomp": mjcf(
            body='<flexcomp type="grid" count="9999 9999 9999" name="f"/>'
        ),
        "attach": mjcf(
            top='<asset><model name="z" file="zero.xml"/></asset>',
            body='<attach model="z" body="b" prefix="p"/>',
        ),
        "includes_itself": mjcf(top='<include file="includes_itself.xml"/>'),
        "includes_a_ring": mjcf(top='<include file="ring.xml"/>'),
        "includes_forty": mjcf(top='<include file="row0.xml"/>'),
        "includes_zeros": mjcf(top='<include file="zero.xml"/>'),
        "includes_elsewhere": mjcf(top='<include file="../../../../etc/passwd"/>'),
        "includes_etc": mjcf(top='<include file="/etc/passwd"/>'),
        "includes_nothing": mjcf(top="<include/>"),
        "terrain": mjcf(
            top='<asset><hfield name="h" nrow="90000" ncol="90000" size="1 1 1 1"/>'
            "</asset>",
            body='<geom type="hfield" hfield="h"/>',
            inertial=False,
        ),
        "nested": mjcf(body="<body>" * 95 + SPHERE + "</body>" * 95),
        "free": mjcf(body='<body><freejoint/><geom size="0.1"/></body>'),
        "weightless": mjcf(inertial=False),
        "not_finite": mjcf(joint='damping="inf"'),
        "no_rotation": mjcf(body='<site quat="0 0 0 0"/>'),
        "same_names": mjcf(body='<body><joint name="axis1"/><geom size="1"/></body>'),
        "unknown_class": mjcf(body='<site class="nowhere"/>'),
    }


def mesh_files(folder):
    """Texts of MJCF files that need a mesh that must be refused."""
    square = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    link_to(folder / "zero.stl", "/dev/zero")
    os.mkfifo(folder / "pipe.obj")
    with (folder / "large.obj").open("wb") as file:
        file.truncate(80_000_000)
    header = b"\0" * 80 + (4_000_000_000).to_bytes(4, "little")
    return {
        "mesh_of_zeros": with_mesh("zero.stl"),
        "mesh_of_a_pipe": with_mesh("pipe.obj"),
        "mesh_of_80_mb": with_mesh("large.obj"),
        "mesh_elsewhere": with_mesh("/usr/share/x.stl"),
        "mesh_counts": with_mesh("counts.stl", header, folder),
        "mesh_indices": with_mesh("far.obj", square + b"f 1 2 999999999\n", folder),
        "mesh_digits": with_mesh("long.obj", b"v 0 0 " + b"1" * 9_000_000, folder),
        "mesh_is_flat": with_mesh("flat.obj", square + b"f 1 1 2\n", folder),
        "mesh_builtin": mjcf(
            top='<asset><mesh name="m" builtin="sphere" params="30"/></asset>',
            body=MESH,
            inertial=False,
        ),
        "mesh_of_many": mjcf(
            top='<asset><mesh name="m" inertia="convex" vertex="'
            + " ".join(f"{i % 97} {i % 89} {i % 83}" for i in range(300_000))
            + '"/></asset>',
            body=MESH,
            inertial=False,
        ),
    }


def loaded_files():
    """Texts of files with things that are left out, so that the arm loads."""
    return {
        "texture": mjcf(
            top='<asset><texture name="t" type="2d" builtin="checker" width="90000" '
            'height="90000"/><material name="w" texture="t"/></asset>',
            body='<geom size="0.1" material="w"/>',
        ),
        "memory": mjcf(top='<size memory="900G" nuserdata="2000000000"/>'),
        "numeric": mjcf(
            top='<custom><numeric name="n" size="2000000000" data="1"/></custom>'
        ),
        "user": mjcf(
            body=f'<site user="{"1 " * 200_000}"/>' + "<site/>" * 4_000,
        ),
        "extension": mjcf(
            top='<extension><plugin plugin="mujoco.sdf.bolt"/></extension>'
        ),
        "sensor": mjcf(last='<sensor><user dim="2000000000"/></sensor>'),
        "bodies": mjcf(body="<body><joint/><geom size='0.01'/></body>" * 1_500),
        "wide": urdf(extra=chain(90)),
        "no_limits": urdf(kind="continuous"),
    }


def _say(line):
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


def _load(name):
    from dovetail.robots.find import find_robot

    find_robot(name)
    return 0


def main():
    """Write the files, and give each to the command."""
    folder = Path.cwd()
    files = {f"{n}.urdf": text for n, text in urdf_files().items()}
    texts = mjcf_files(folder) | mesh_files(folder)
    files |= {f"{n}.xml": text for n, text in texts.items()}
    files |= {
        f"{n}.{'urdf' if text.startswith('<robot') else 'xml'}": text
        for n, text in loaded_files().items()
    }
    for name, text in files.items():
        (folder / name).write_text(text)
    (folder / "latin.urdf").write_bytes(urdf(extra="<a b='\xff'/>").encode("latin-1"))
    link_to(folder / "zeros.urdf", "/dev/zero")
    os.mkfifo(folder / "pipe.urdf")
    (folder / "folder.urdf").mkdir()
    with (folder / "large.urdf").open("wb") as file:
        file.truncate(80_000_000)
    names = [*files, "latin.urdf", "zeros.urdf", "pipe.urdf", "folder.urdf"]
    names += ["large.urdf", "absent.urdf"]
    lines = ["from dovetail.robots.robot import Robot"]
    for i, name in enumerate(names):
        kind, options = "urdf", ""
        if name.endswith(".xml"):
            kind, options = "mjcf", ", dq_max=[1.0] * 7"
        if name == "bodies.xml":
            options += ", joints=[f'axis{i}' for i in range(1, 8)]"
        lines.append(f"def arm{i}(): return Robot.from_{kind}({name!r}{options})")
    (folder / "hostile_arms.py").write_text("\n".join(lines))
    from dovetail.cli import run

    loaded = {*loaded_files()}
    for i, name in enumerate(names):
        _say({"begins": name})
        begin = time.process_time()
        words = ["identify", "record", "--robot", f"hostile_arms:arm{i}", "--out", "x"]
        is_loaded = Path(name).stem in loaded
        code = run(words) if not is_loaded else _load(f"hostile_arms:arm{i}")
        _say(
            {
                "name": name,
                "code": code,
                "is_loaded": is_loaded,
                "seconds": time.process_time() - begin,
                "bytes": peak_bytes(),
            }
        )


if __name__ == "__main__":
    sys.path.insert(0, str(Path.cwd()))
    main()
