"""The Franka Research 3: geometry, limits and the maker's published inertias."""

import numpy as np

from dovetail.robots.geometry import Geometry
from dovetail.robots.links import Links, inertia_set
from dovetail.robots.motors import Motors
from dovetail.robots.robot import Robot
from dovetail.robots.robot_limits import RobotLimits

# Modified DH parameters of the maker's documentation; joint axes are local z.
_STRAIGHT = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
_BACK = ((1, 0, 0), (0, 0, 1), (0, -1, 0))  # by -90 deg about x
_FORTH = ((1, 0, 0), (0, 0, -1), (0, 1, 0))  # by +90 deg about x
_ROTATIONS = (_STRAIGHT, _BACK, _FORTH, _FORTH, _BACK, _FORTH, _FORTH)
GEOMETRY = Geometry(
    origin_position=np.array(
        (
            (0.0, 0.0, 0.333),
            (0.0, 0.0, 0.0),
            (0.0, -0.316, 0.0),
            (0.0825, 0.0, 0.0),
            (-0.0825, 0.384, 0.0),
            (0.0, 0.0, 0.0),
            (0.088, 0.0, 0.0),
        )
    ),
    origin_rotation=np.array(_ROTATIONS, dtype=float),
    flange_position=np.array((0.0, 0.0, 0.107)),
)

# libfranka 0.21, rate_limiting.h, and franka_description, joint_limits.yaml: position,
# speed, torque; deceleration and offset of the speed limit that depends on position.
_Q_MIN = (-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196)
_Q_MAX = (2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196)
_DQ_MAX = (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26)
# At full speed A2, stretched out with a hand, has too little torque left to brake with.
_SPEED_SHARE = 0.5
TAU_MAX = (87, 87, 87, 87, 12, 12, 12)
_TAPER_BRAKE = (6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0)
_TAPER_OFFSET = (0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35)
DTAU_MAX = 1000.0

# franka_description, robots/fr3/inertials.yaml: mass, com, (Ixx, Iyy, Izz) and
# (Ixy, Ixz, Iyz) about the com.
_LINKS = (
    (2.9274653454, (4.128e-07, -0.0181251324, -0.0386035970),
     (0.023927316, 0.022482161, 0.006350098),
     (1.3317903e-05, -0.00011404775, -0.0019950321)),
    (2.9355370338, (0.0031828864, -0.0743221644, 0.0088146084),
     (0.041938946, 0.025145149, 0.061702145),
     (0.00020257332, 0.0040777842, -0.0042252158)),
    (2.2449013699, (0.0407015686, -0.0048200565, -0.0289730823),
     (0.024101425, 0.019740533, 0.019044494),
     (0.0024046946, -0.0028562693, -0.0021042127)),
    (2.6155955791, (-0.0459100965, 0.0630492960, -0.0085187868),
     (0.034529983, 0.028881622, 0.041254712),
     (0.013225523, 0.010151430, -0.00097628337)),
    (2.3271207594, (-0.0016039605, 0.0292536262, -0.0972965990),
     (0.051610278, 0.047877297, 0.016423626),
     (-0.0057151734, -0.0035673168, 0.010673985)),
    (1.8170376524, (0.0597131221, -0.0410294666, -0.0101692726),
     (0.0054123336, 0.014058330, 0.016080818),
     (0.0061934564, 0.0014219289, -0.0013140754)),
    (0.6271432862, (0.0045225817, 0.0086261921, -0.0161633251),
     (0.00021092389, 0.00017718568, 5.9931906e-05),
     (-2.4332991e-05, 4.5644804e-05, 8.7440702e-05)),
)  # fmt: skip

# A MuJoCo model of the arm that was fitted to motions: mujoco_menagerie, franka_fr3.
_DAMPING = (0.21,) * 7
_ARMATURE = (0.195,) * 4 + (0.074,) * 3
POSTURES = {
    "down": np.array([0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.785]),
    "forward": np.array([0.0, -0.3, 0.0, -2.2, 0.0, 3.47, 0.785]),
}
"""Elbow up; the tool down over a table, or level [rad]."""


def fr3() -> Robot:
    """Return the Franka Research 3 without a tool."""
    return Robot(
        name="fr3",
        geometry=GEOMETRY,
        links=Links(**inertia_set(_LINKS)._asdict()),
        limits=RobotLimits(
            q_min=np.array(_Q_MIN),
            q_max=np.array(_Q_MAX),
            dq_max=_SPEED_SHARE * np.array(_DQ_MAX),
            tau_max=np.array(TAU_MAX, dtype=float),
            taper_brake=np.array(_TAPER_BRAKE),
            taper_offset=np.array(_TAPER_OFFSET),
            dtau_max=np.full(7, DTAU_MAX),
        ),
        motors=Motors(damping=np.array(_DAMPING), armature=np.array(_ARMATURE)),
        postures=POSTURES,
        gripper="franka_hand",
    )
