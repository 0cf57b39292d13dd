"""The Franka Emika Panda (FER): geometry, limits, and inertias from a real arm."""

import numpy as np

from dovetail.robots.fr3 import DTAU_MAX, GEOMETRY, POSTURES, TAU_MAX
from dovetail.robots.links import Links, inertia_set
from dovetail.robots.motors import Motors
from dovetail.robots.robot import Robot
from dovetail.robots.robot_limits import RobotLimits

# franka_ros, franka_description/robots/panda/joint_limits.yaml: position, speed and
# torque. libfranka 0.9, rate_limiting.h: change of the torque. Both are as on a
# Research 3. The speed limit does not fall towards the position limits, as there.
_Q_MIN = (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973)
_Q_MAX = (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973)
_DQ_MAX = (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
# At full speed A2, stretched out with a hand, has too little torque left to brake with.
_SPEED_SHARE = 0.75

# Identified on a real arm (Gaz et al., 2019), as franka_ros has them in
# franka_description/robots/common/inertial.yaml, and mujoco_menagerie in
# franka_emika_panda: mass, com, (Ixx, Iyy, Izz) and (Ixy, Ixz, Iyz) about the com. The
# moments of link 1 about x and y never act. The newer franka_description,
# robots/fer/inertials.yaml, is not taken: no body has the inertia of its link 4, whose
# largest moment is 0.0011 kg m2 above the sum of the other two.
_LINKS = (
    (4.970684, (0.003875, 0.002081, -0.04762),
     (0.70337, 0.70661, 0.009117), (-0.000139, 0.006772, 0.019169)),
    (0.646926, (-0.003141, -0.02872, 0.003495),
     (0.007962, 0.02811, 0.025995), (-0.003925, 0.010254, 0.000704)),
    (3.228604, (0.027518, 0.039252, -0.066502),
     (0.037242, 0.036155, 0.01083), (-0.004761, -0.011396, -0.012805)),
    (3.587895, (-0.05317, 0.104419, 0.027454),
     (0.025853, 0.019552, 0.028323), (0.007796, -0.001332, 0.008641)),
    (1.225946, (-0.011953, 0.041065, -0.038437),
     (0.035549, 0.029474, 0.008627), (-0.002117, -0.004037, 0.000229)),
    (1.666555, (0.060149, -0.014117, -0.010517),
     (0.001964, 0.004354, 0.005433), (0.000109, -0.001158, 0.000341)),
    (0.735522, (0.010517, -0.004252, 0.061597),
     (0.012516, 0.010027, 0.004815), (-0.000428, -0.001196, -0.000741)),
)  # fmt: skip

# mujoco_menagerie, franka_emika_panda; Franka publishes neither.
_DAMPING = (1.0,) * 7
_ARMATURE = (0.1,) * 7


def panda() -> Robot:
    """Return the Franka Emika Panda without a tool."""
    return Robot(
        name="panda",
        geometry=GEOMETRY,  # franka_description, robots/fer/kinematics.yaml: the same
        links=Links(**inertia_set(_LINKS)._asdict()),
        limits=RobotLimits(
            q_min=np.array(_Q_MIN),
            q_max=np.array(_Q_MAX),
            dq_max=_SPEED_SHARE * np.array(_DQ_MAX),
            tau_max=np.array(TAU_MAX, dtype=float),
            dtau_max=np.full(7, DTAU_MAX),
        ),
        motors=Motors(damping=np.array(_DAMPING), armature=np.array(_ARMATURE)),
        postures=POSTURES,
        gripper="franka_hand",
    )
