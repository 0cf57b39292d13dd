"""A learner in a process of its own: steps until it is killed.

python learner.py grpc://HOST:PORT DURATION|leave|acquire Q1 ... Q7
"""

import sys
import time

import numpy as np

from dovetail import _core
from dovetail.arms.remote_arm import GrpcAddress, RemoteArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.poses import Pose, quat_about_z

robot = find_cell().loaded_robot()
settings = ControllerSettings(
    osc=OscConfig(),
    limits=LimitConfig.for_period(robot, 0.005),
    task=TaskSpec.parse("XYZ:force A:pose BC:hold"),
    period=0.005,
)
address = GrpcAddress.parse(sys.argv[1])
arm = RemoteArm(address, settings, robot=robot)
if sys.argv[2] == "acquire":
    sys.stdout.write("moving\n")
    sys.stdout.flush()
    time.sleep(60.0)
q = [float(word) for word in sys.argv[3:]]
arm.reset(np.array(q), Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0)))
target = _core.Target(quat_wxyz_d=np.array([0.0, 1.0, 0.0, 0.0]))
arm.step(target)
sys.stdout.write("moving\n")
sys.stdout.flush()
if sys.argv[2] == "leave":
    sys.exit()
while True:
    arm.step(target, float(sys.argv[2]))
