"""The KUKA LBR Med 14 R820: an LBR iiwa 14 for medicine, some 2 kg heavier."""

import numpy as np

from dovetail.robots.iiwa14 import DQ_MAX_DEG, TAU_MAX
from dovetail.robots.lbr import in_our_frames, lbr_arm
from dovetail.robots.links import Links
from dovetail.robots.robot import Robot

# An iiwa 14's 0.360 / 0.420 / 0.400 / 0.126 m along the arm, joints at the heights of
# lbr_description. There A1 is 0.5 mm lower.
_ORIGINS = (
    (0.0, 0.0, 0.1475),
    (0.0, 0.0, 0.2125),
    (0.0, 0.228, 0.0),
    (0.0, 0.0, 0.192),
    (0.0, 0.2075, 0.0),
    (0.0, 0.0, 0.1925),
    (0.0, 0.091, 0.0),
)
_FLANGE = (0.0, 0.0, 0.035)

# lbr_description (lbr_fri_ros2_stack), urdf/med14/med14_description.xacro, in its own
# frames (`lbr`): joint origin in the parent, and mass, com, (Ixx, Iyy, Izz),
# (Ixy, Ixz, Iyz). With its base they are KUKA's 32.3 kg.
_LBR = (
    ((0, 0, 0.1475),
     (5.591419, (0, -0.033795, 0.132404),
      (0.044885, 0.045283, 0.016776), (0, 0, 0.006703))),
    ((0, -0.01, 0.2125),
     (6.013411, (0.000136, 0.047546, 0.076324),
      (0.05833, 0.057062, 0.017466), (-0.000035, 0.000059, 0.010605))),
    ((0, 0.01, 0.228),
     (3.65879, (0, 0.034913, 0.123108),
      (0.02296, 0.021913, 0.00814), (0, 0, -0.004065))),
    ((0, 0.0105, 0.192),
     (4.358267, (0, -0.039793, 0.086944),
      (0.034255, 0.032512, 0.010444), (0, 0, -0.006365))),
    ((0, -0.0105, 0.2075),
     (1.653015, (0, -0.029824, 0.076267),
      (0.009172, 0.007714, 0.004159), (0, 0, 0.003033))),
    ((0, -0.0707, 0.1925),
     (2.598211, (-1e-06, 0.07102, 0.004953),
      (0.00764, 0.007355, 0.005004), (0, 0, 0.000336))),
    ((0, 0.0707, 0.091),
     (0.280474, (3e-06, -2e-06, 0.013782),
      (0.000185, 0.000185, 0.000323), (0, 0, 0))),
)  # fmt: skip


def med14() -> Robot:
    """Return the LBR Med 14 R820 without a tool."""
    links = Links(**in_our_frames(_LBR, np.array(_ORIGINS))._asdict())
    # Limits of an iiwa 14. lbr_description, urdf/med14/joint_limits.yaml, has the
    # same ranges and speeds; its torques, 200 Nm everywhere, are not the robot's.
    return lbr_arm("med14", _ORIGINS, _FLANGE, links, DQ_MAX_DEG, TAU_MAX)
