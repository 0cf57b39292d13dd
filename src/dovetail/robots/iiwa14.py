"""The KUKA LBR iiwa 14 R820: geometry, limits and three published inertia sets."""

from dataclasses import replace

import numpy as np

from dovetail.robots.drawn import Drawn, bullet_file
from dovetail.robots.lbr import POSTURES, in_our_frames, lbr_arm
from dovetail.robots.links import InertiaSet, Links
from dovetail.robots.robot import Robot
from dovetail.types import Array

# Joint origins of the pybullet_data and Drake models, which agree with each other and
# with the data sheet's 0.360 / 0.420 / 0.400 / 0.126 m along the arm.
_ORIGINS = (
    (0.0, 0.0, 0.1575),
    (0.0, 0.0, 0.2025),
    (0.0, 0.2045, 0.0),
    (0.0, 0.0, 0.2155),
    (0.0, 0.1845, 0.0),
    (0.0, 0.0, 0.2155),
    (0.0, 0.081, 0.0),
)
_FLANGE = (0.0, 0.0, 0.045)

# KUKA data sheet, LBR iiwa 14 R820. The limits inside the public URDF files (300 Nm and
# 10 rad/s, or 200 Nm everywhere) are not the robot's.
DQ_MAX_DEG = (85, 85, 100, 75, 130, 135, 135)
TAU_MAX = (320, 320, 176, 176, 110, 40, 40)

# Centres of mass: pybullet_data kuka_iiwa/model.urdf = Drake iiwa14, same link frames.
_COM = (
    (0, -0.03, 0.12),
    (0.0003, 0.059, 0.042),
    (0, 0.03, 0.13),
    (0, 0.067, 0.034),
    (0.0001, 0.021, 0.076),
    (0, 0.0006, 0.0004),
    (0, 0, 0.02),
)
_DRAKE_MASS = (5.76, 6.35, 3.5, 3.5, 3.5, 1.8, 1.2)
_DRAKE_INERTIA = (
    (0.033, 0.0333, 0.0123),
    (0.0305, 0.011, 0.0304),
    (0.025, 0.0238, 0.0076),
    (0.017, 0.006, 0.0164),
    (0.01, 0.0087, 0.00449),
    (0.0049, 0.0047, 0.0036),
    (0.001, 0.001, 0.001),
)
_PYBULLET_MASS = (4, 4, 3, 2.7, 1.7, 1.8, 0.3)
_PYBULLET_INERTIA = (
    (0.1, 0.09, 0.02),
    (0.05, 0.018, 0.044),
    (0.08, 0.075, 0.01),
    (0.03, 0.01, 0.029),
    (0.02, 0.018, 0.005),
    (0.005, 0.0036, 0.0047),
    (0.001, 0.001, 0.001),
)

# lbr_description (lbr_fri_ros2_stack), in its own frames (`lbr`): joint origin
# in the parent, and mass, com, (Ixx, Iyy, Izz), (Ixy, Ixz, Iyz).
_LBR = (
    ((0, 0, 0.1475),
     (5.289529, (0, -0.033795, 0.132404),
      (0.042462, 0.042838, 0.01587), (0, 0, 0.006341))),
    ((0, -0.01, 0.2125),
     (5.688888, (0.000136, 0.047548, 0.076322),
      (0.055182, 0.053983, 0.016523), (-0.000033, 0.000056, 0.010034))),
    ((0, 0.01, 0.228),
     (3.461245, (0, 0.034913, 0.123108),
      (0.02172, 0.02073, 0.007701), (0, 0, -0.003845))),
    ((0, 0.0105, 0.192),
     (4.122995, (0, -0.039793, 0.086944),
      (0.03241, 0.030758, 0.009883), (0, 0, -0.006022))),
    ((0, -0.0105, 0.2075),
     (1.563756, (0, -0.029824, 0.076267),
      (0.008677, 0.007297, 0.003935), (0, 0, 0.002869))),
    ((0, -0.0707, 0.1925),
     (2.457878, (0, 0.07102, 0.00495),
      (0.007227, 0.006958, 0.004734), (0, 0, 0.000318))),
    ((0, 0.0707, 0.091),
     (0.265331, (0, 0, 0.013782),
      (0.000175, 0.000175, 0.000306), (0, 0, 0))),
)  # fmt: skip

INERTIA_SETS = ("drake", "pybullet", "lbr")
"""Published inertia sets. The controller uses drake; they differ by up to 35 %."""
_REST = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
"""Posture with the tool 0.1 m over a fixture [rad]."""


def iiwa14(inertia: str = "drake") -> Robot:
    """Return the LBR iiwa 14 R820 without a tool.

    Args:
        inertia: ``drake`` (Drake and mujoco_menagerie, the controller's model),
            ``pybullet`` (pybullet_data, iiwa_ros) or ``lbr`` (lbr_description).

    Raises:
        ConfigError: Unknown inertia set.
    """
    drake, pybullet = (
        InertiaSet(np.array(mass, dtype=float), np.array(_COM, dtype=float), inertias)
        for mass, inertias in (
            (_DRAKE_MASS, _diagonal(_DRAKE_INERTIA)),
            (_PYBULLET_MASS, _diagonal(_PYBULLET_INERTIA)),
        )
    )
    lbr = in_our_frames(_LBR, np.array(_ORIGINS))
    links = Links(
        **drake._asdict(),
        inertia_set="drake",
        inertia_sets={"drake": drake, "pybullet": pybullet, "lbr": lbr},
    )
    arm = lbr_arm("iiwa14-drake", _ORIGINS, _FLANGE, links, DQ_MAX_DEG, TAU_MAX)
    postures = {"down": POSTURES["down"], "rest": _REST, "forward": POSTURES["forward"]}
    return replace(arm, postures=postures, drawn=_drawn()).with_inertia(inertia)


def _drawn() -> tuple[tuple[Drawn, ...], ...]:
    """Return pybullet_data's meshes, whose frames are our links'."""
    files = [bullet_file("kuka_iiwa", "meshes", f"link_{i}.stl") for i in range(8)]
    return tuple(
        () if file is None else (Drawn(file, np.zeros(3), np.eye(3)),) for file in files
    )


def _diagonal(moments: tuple[tuple[float, ...], ...]) -> Array:
    return np.array([np.diag(row) for row in moments])
