"""What is generated from proto/dovetail.proto is what is committed."""

import subprocess
import sys
from dataclasses import fields
from pathlib import Path

from dovetail.robots.geometry import Geometry
from dovetail.robots.links import Links
from dovetail.robots.motors import Motors
from dovetail.robots.robot import Robot
from dovetail.robots.robot_limits import RobotLimits
from dovetail.rpc import dovetail_pb2 as pb
from extras import need

ROOT = Path(__file__).parents[2]


def test_generating_again_gives_the_same_bytes(tmp_path):
    need("grpc_tools")
    subprocess.run(
        [
            *(sys.executable, "-m", "grpc_tools.protoc", "-Idovetail/rpc=proto"),
            *(f"--python_out={tmp_path}", f"--pyi_out={tmp_path}"),
            "proto/dovetail.proto",
        ],
        cwd=ROOT,
        check=True,
        timeout=60,
    )
    for name in ("dovetail_pb2.py", "dovetail_pb2.pyi"):
        fresh = (tmp_path / "dovetail" / "rpc" / name).read_bytes()
        assert fresh == (ROOT / "src" / "dovetail" / "rpc" / name).read_bytes(), (
            f"{name} is not what proto/dovetail.proto gives: run `make proto`"
        )


def test_the_message_has_every_field_of_a_robot():
    in_message = {field.name for field in pb.RobotModel.DESCRIPTOR.fields}
    parts = {"geometry": Geometry, "links": Links, "limits": RobotLimits}
    parts["motors"] = Motors
    # Of no use to the controller.
    here = {"postures", "inertia_set", "inertia_sets", "drawn", "coulomb", "notes"}
    here |= {"gripper"}
    named = {f.name for kind in (Robot, *parts.values()) for f in fields(kind)}
    assert in_message == named - here - set(parts)
