"""The KUKA LBR iiwa 7 R800: geometry, limits and published masses."""

import numpy as np

from dovetail.robots.lbr import in_our_frames, lbr_arm
from dovetail.robots.links import Links
from dovetail.robots.robot import Robot

# The data sheet's 0.340 / 0.400 / 0.400 / 0.126 m along the arm; joints at the heights
# of lbr_description.
_ORIGINS = (
    (0.0, 0.0, 0.1475),
    (0.0, 0.0, 0.1925),
    (0.0, 0.2075, 0.0),
    (0.0, 0.0, 0.1925),
    (0.0, 0.2075, 0.0),
    (0.0, 0.0, 0.1925),
    (0.0, 0.091, 0.0),
)
_FLANGE = (0.0, 0.0, 0.035)

# KUKA data sheet, LBR iiwa 7 R800. The speeds and, but for 1 deg that it leaves at
# each end, the ranges are those of lbr_description, urdf/iiwa7/joint_limits.yaml; the
# torques those of Drake's iiwa7 models. 200 Nm everywhere, as lbr_description has it,
# and 300 Nm, as older models do, are not the robot's.
_DQ_MAX_DEG = (98, 98, 100, 130, 140, 180, 180)
_TAU_MAX = (176, 176, 110, 110, 110, 40, 40)

# lbr_description (lbr_fri_ros2_stack), urdf/iiwa7/iiwa7_description.xacro, in its own
# frames (`lbr`): joint origin in the parent, and mass, com, (Ixx, Iyy, Izz),
# (Ixy, Ixz, Iyz). With its base they are the data sheet's 23.9 kg.
_LBR = (
    ((0, 0, 0.1475),
     (3.394011, (0, -0.034819, 0.123299),
      (0.021383, 0.020403, 0.007563), (0, 0, 0.003797))),
    ((0, -0.0105, 0.1925),
     (4.031991, (0, 0.039793, 0.086944),
      (0.031697, 0.03008, 0.009666), (0, 0, 0.005889))),
    ((0, 0.0105, 0.2075),
     (3.394011, (0, 0.034819, 0.123299),
      (0.021383, 0.020403, 0.007563), (0, 0, -0.003797))),
    ((0, 0.0105, 0.1925),
     (4.031989, (0, -0.039793, 0.086944),
      (0.031695, 0.030079, 0.009665), (0, 0, -0.005889))),
    ((0, -0.0105, 0.2075),
     (1.529239, (0, -0.029824, 0.076267),
      (0.008485, 0.007136, 0.003848), (0, 0, 0.002806))),
    ((0, -0.0707, 0.1925),
     (2.403626, (0, 0.07102, 0.00495),
      (0.007067, 0.006804, 0.004629), (0, 0, 0.000311))),
    ((0, 0.0707, 0.091),
     (0.259474, (3e-06, -2e-06, 0.013782),
      (0.000171, 0.000171, 0.000299), (0, 0, 0))),
)  # fmt: skip


def iiwa7() -> Robot:
    """Return the LBR iiwa 7 R800 without a tool."""
    links = Links(**in_our_frames(_LBR, np.array(_ORIGINS))._asdict())
    return lbr_arm("iiwa7", _ORIGINS, _FLANGE, links, _DQ_MAX_DEG, _TAU_MAX)
