"""The Kinova Gen3 with seven joints: geometry, limits and the maker's masses."""

import numpy as np

from dovetail.robots.geometry import Geometry
from dovetail.robots.links import Links, inertia_set
from dovetail.robots.motors import Motors
from dovetail.robots.robot import Robot
from dovetail.robots.robot_limits import RobotLimits

# ros2_kortex, kortex_description/arms/gen3/7dof/urdf/gen3_macro.xacro: origins of the
# joints in their parents, and the end effector's frame in the last link.
_ORIGINS = (
    (0.0, 0.0, 0.15643),
    (0.0, 0.005375, -0.12838),
    (0.0, -0.21038, -0.006375),
    (0.0, 0.006375, -0.21038),
    (0.0, -0.20843, -0.006375),
    (0.0, 0.00017505, -0.10593),
    (0.0, -0.10593, -0.00017505),
)
_FLANGE = (0.0, 0.0, -0.061525)
_OVER = ((1, 0, 0), (0, -1, 0), (0, 0, -1))  # by 180 deg about x
_BACK = ((1, 0, 0), (0, 0, 1), (0, -1, 0))  # by -90 deg about x
_FORTH = ((1, 0, 0), (0, 0, -1), (0, 1, 0))  # by +90 deg about x
_ROTATIONS = (_OVER, _FORTH, _BACK, _FORTH, _BACK, _FORTH, _BACK)

# Ranges of actuators 2, 4 and 6 in the user guide (UG-014); the URDF's are up to 0.16
# rad wider. The others turn without end, which an arm in contact does not need: they
# get one turn.
_TURN = 180.0
_Q_MAX_DEG = (_TURN, 128.9, _TURN, 147.8, _TURN, 120.3, _TURN)
_DQ_MAX = (1.3963, 1.3963, 1.3963, 1.3963, 1.2218, 1.2218, 1.2218)  # the URDF's
# Above these torques the arm itself warns, by default (user guide, actuator safeties);
# at 104.5 and 51.3 Nm it stops. mujoco_menagerie has 105 and 52 Nm, the largest
# thresholds that can be set. The URDF has 39 and 9 Nm, a MuJoCo model that cites the
# user guide 32 Nm: with these A2, stretched out, lifts a gripper but cannot brake it.
# It is not said that the actuators bear 56.7 Nm for hours.
_TAU_MAX = (56.7, 56.7, 56.7, 56.7, 29.4, 29.4, 29.4)

# The same URDF, with the camera: mass, com, (Ixx, Iyy, Izz) and (Ixy, Ixz, Iyz) about
# the com.
_LINKS = (
    (1.3773, (-2.3e-05, -0.010364, -0.07336),
     (0.00457, 0.004831, 0.001409), (1e-06, 2e-06, 0.000448)),
    (1.1636, (-4.4e-05, -0.09958, -0.013278),
     (0.011088, 0.001072, 0.011255), (5e-06, 0.0, -0.000691)),
    (1.1636, (-4.4e-05, -0.006641, -0.117892),
     (0.010932, 0.011127, 0.001043), (0.0, -7e-06, 0.000606)),
    (0.9302, (-1.8e-05, -0.075478, -0.015006),
     (0.008147, 0.000631, 0.008316), (-1e-06, 0.0, -0.0005)),
    (0.6781, (1e-06, -0.009432, -0.063883),
     (0.001596, 0.001607, 0.000399), (0.0, 0.0, 0.000256)),
    (0.6781, (1e-06, -0.045483, -0.00965),
     (0.001641, 0.00041, 0.001641), (0.0, 0.0, -0.000278)),
    (0.5, (0.000281, 0.011402, -0.029798),
     (0.000587, 0.000369, 0.000609), (3e-06, 3e-06, -0.000118)),
)  # fmt: skip

# Kinova publishes neither. Damping: mujoco_menagerie, kinova_gen3_7dof. Rotor inertia:
# a torque controller of the real arm, github.com/empriselab/gen3_compliant_controllers.
_DAMPING = (1.0,) * 7
_ARMATURE = (0.3, 0.3, 0.3, 0.3, 0.18, 0.18, 0.2)
_POSTURES = {
    "down": np.array([0.0, 0.58, 0.0, 1.39, 0.0, 1.17, 0.0]),
    "forward": np.array([0.0, 0.7, 0.0, 1.8, 0.0, -0.93, 0.0]),
}
"""Elbow up; the tool down over a table, or level [rad]."""


def gen3() -> Robot:
    """Return the Kinova Gen3 without a tool."""
    q_max = np.deg2rad(_Q_MAX_DEG)
    return Robot(
        name="gen3",
        geometry=Geometry(
            origin_position=np.array(_ORIGINS),
            origin_rotation=np.array(_ROTATIONS, dtype=float),
            flange_position=np.array(_FLANGE),
            flange_rotation=np.array(_OVER, dtype=float),
        ),
        links=Links(**inertia_set(_LINKS)._asdict()),
        limits=RobotLimits(
            q_min=-q_max,
            q_max=q_max,
            dq_max=np.array(_DQ_MAX),
            tau_max=np.array(_TAU_MAX),
        ),
        motors=Motors(damping=np.array(_DAMPING), armature=np.array(_ARMATURE)),
        postures=_POSTURES,
        gripper="robotiq_2f85",
    )
