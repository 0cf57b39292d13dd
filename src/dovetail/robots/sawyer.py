"""The Rethink Sawyer: geometry, limits and the maker's masses."""

import numpy as np

from dovetail.robots.geometry import Geometry
from dovetail.robots.inertia import merge_bodies
from dovetail.robots.links import Links, inertia_set
from dovetail.robots.robot import Robot
from dovetail.robots.robot_limits import RobotLimits

# sawyer_robot, sawyer_description/urdf/sawyer_base.urdf.xacro: origins, ranges, speeds
# and torques of right_j0 to right_j6, and right_hand in the last link. Joint 6 is
# turned by 10 deg about its axis.
_ORIGINS = (
    (0.0, 0.0, 0.08),
    (0.081, 0.05, 0.237),
    (0.0, -0.14, 0.1425),
    (0.0, -0.042, 0.26),
    (0.0, -0.125, -0.1265),
    (0.0, 0.031, 0.275),
    (0.0, -0.11, 0.1053),
)
_FLANGE = (0.0, 0.0, 0.0245)
_STRAIGHT = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
_SHOULDER = ((0, -1, 0), (0, 0, 1), (-1, 0, 0))
_BACK = ((1, 0, 0), (0, 0, 1), (0, -1, 0))  # by -90 deg about x
_FORTH = ((1, 0, 0), (0, 0, -1), (0, 1, 0))  # by +90 deg about x
_C, _S = np.cos(0.17453), np.sin(0.17453)
_WRIST = ((-_C, -_S, 0), (0, 0, -1), (_S, -_C, 0))
_HAND = ((0, -1, 0), (1, 0, 0), (0, 0, 1))  # by 90 deg about z
_ROTATIONS = (_STRAIGHT, _SHOULDER, _FORTH, _BACK, _FORTH, _BACK, _WRIST)
_Q_MIN = (-3.0503, -3.8095, -3.0426, -3.0439, -2.9761, -2.9761, -4.7124)
_Q_MAX = (3.0503, 2.2736, 3.0426, 3.0439, 2.9761, 2.9761, 4.7124)
_DQ_MAX = (1.74, 1.328, 1.957, 1.957, 3.485, 3.485, 4.545)
# At full speed A5 has little more than it needs to brake with.
_SPEED_SHARE = 0.75
_TAU_MAX = (80, 80, 40, 40, 9, 9, 9)

# The same: mass, com, (Ixx, Iyy, Izz) and (Ixy, Ixz, Iyz) about the com.
_LINKS = (
    (5.3213, (0.024366, 0.010969, 0.14363),
     (0.053314, 0.057902, 0.023659), (0.0047093, 0.011734, 0.0080179)),
    (4.505, (-0.0030849, -0.026811, 0.092521),
     (0.022398, 0.014613, 0.017295), (-0.00023986, -0.00029362, -0.0060875)),
    (1.745, (-0.00016044, -0.014967, 0.13582),
     (0.025506, 0.0253, 0.0034179), (4.4101e-06, 1.4955e-05, -0.0033204)),
    (2.5097, (-0.0048135, -0.0281, -0.084154),
     (0.01016, 0.0065685, 0.0069078), (-9.7452e-06, 0.00026624, 0.0030316)),
    (1.1136, (-0.0018844, 0.0069001, 0.1341),
     (0.013557, 0.013555, 0.0013658), (1.8109e-05, 0.00013523, 0.0010561)),
    (1.5625, (0.0061133, -0.023697, 0.076416),
     (0.0047328, 0.0029676, 0.0031762), (0.00011526, 4.6269e-05, -0.0011557)),
    (0.3292, (-8.0726e-06, 0.0085838, -0.0049566),
     (0.00031105, 0.00021549, 0.00035976), (1.4771e-06, -3.7074e-07, -8.4533e-06)),
)  # fmt: skip

# The head, which turns about joint 1's axis and is left at zero: mass, com and inertia
# in link 1's frame.
_HEAD = (
    1.5795, (0.0053207, -2.6549e-05, 0.3986),
    (0.011833, 0.0082709, 0.0049661), (-4.4669e-06, 4.9425e-05, 4.2124e-07),
)  # fmt: skip

# Damping and rotor inertia are dovetail's own, 0.5 Nms/rad and 0.1 kg m2. Rethink
# publishes neither: 5 Nms/rad and 5 Nm of friction, as its URDF has at every joint,
# steady a simulation, and so does mujoco_menagerie's 1 kg m2 (rethink_robotics_sawyer).
_POSTURES = {
    "down": np.array([-0.19, -1.12, -0.26, 1.8, 0.14, 0.91, -0.97]),
    "forward": np.array([-0.58, -1.32, 0.28, 2.13, -0.41, -0.82, -0.24]),
}
"""Elbow up; the tool down over a table, or level [rad]."""


def sawyer() -> Robot:
    """Return the Rethink Sawyer without a tool; its head is part of link 1."""
    masses, coms, inertias = inertia_set((*_LINKS, _HEAD))
    bodies = list(zip(masses, coms, inertias, strict=True))
    masses[0], coms[0], inertias[0] = merge_bodies(bodies[0], bodies[7])
    return Robot(
        name="sawyer",
        geometry=Geometry(
            origin_position=np.array(_ORIGINS),
            origin_rotation=np.array(_ROTATIONS, dtype=float),
            flange_position=np.array(_FLANGE),
            flange_rotation=np.array(_HAND, dtype=float),
        ),
        links=Links(mass=masses[:7], com=coms[:7], inertia=inertias[:7]),
        limits=RobotLimits(
            q_min=np.array(_Q_MIN),
            q_max=np.array(_Q_MAX),
            dq_max=_SPEED_SHARE * np.array(_DQ_MAX),
            tau_max=np.array(_TAU_MAX, dtype=float),
        ),
        postures=_POSTURES,
        gripper="franka_hand",
    )
