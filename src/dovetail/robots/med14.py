"""The KUKA LBR Med 14 R820: an LBR iiwa 14 for medicine, some 2 kg heavier."""

import numpy as np

from dovetail.robots.geometry import Geometry
from dovetail.robots.lbr_frames import ROTATIONS, in_our_frames
from dovetail.robots.links import Links
from dovetail.robots.robot import Robot
from dovetail.robots.robot_limits import RobotLimits

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

# lbr_description, urdf/med14/joint_limits.yaml: ranges and speeds, an iiwa 14's. Its
# torques are 200 Nm everywhere, which is not the robot's: here an iiwa 14's are taken
# (data sheet), whose payload, reach, ranges and speeds this arm shares.
_Q_MAX_DEG = (170, 120, 170, 120, 170, 120, 175)
_DQ_MAX_DEG = (85, 85, 100, 75, 130, 135, 135)
_TAU_MAX = (320, 320, 176, 176, 110, 40, 40)

# lbr_description (lbr_fri_ros2_stack), urdf/med14/med14_description.xacro, in its own
# frames (`lbr_frames`): joint origin in the parent, and mass, com, (Ixx, Iyy, Izz),
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
_POSTURES = {
    "down": np.array([0.0, 0.6, 0.0, -1.6, 0.0, 0.95, 0.0]),
    "forward": np.array([0.0, 0.6, 0.0, -1.6, 0.0, -0.63, 0.0]),
}
"""Elbow up; the tool down over a table, or level [rad]."""


def med14() -> Robot:
    """Return the LBR Med 14 R820 without a tool."""
    q_max, origins = np.deg2rad(_Q_MAX_DEG), np.array(_ORIGINS)
    return Robot(
        name="med14",
        geometry=Geometry(
            origin_position=origins,
            origin_rotation=ROTATIONS,
            flange_position=np.array(_FLANGE),
        ),
        links=Links(**in_our_frames(_LBR, origins)._asdict()),
        limits=RobotLimits(
            q_min=-q_max,
            q_max=q_max,
            dq_max=np.deg2rad(_DQ_MAX_DEG),
            tau_max=np.array(_TAU_MAX, dtype=float),
        ),
        postures=_POSTURES,
    )
