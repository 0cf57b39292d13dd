"""Engines under test, and a pose above the hole that every test can start from."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.poses import Pose, quat_about_z
from extras import need

TOOL_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
# Elbow up, tool down, about 0.1 m above the block.
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
Q_BENT = np.array([0.3, 0.5, -0.2, -1.2, 0.4, 0.9, 0.7])
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
MODULES = {"bullet": "pybullet", "drake": "pydrake"}
ENGINES = ["mujoco", pytest.param("bullet", marks=pytest.mark.bullet), "drake"]


@pytest.fixture(params=ENGINES)
def engine(request):
    if request.param != "mujoco":
        need(MODULES[request.param])
    return request.param


@pytest.fixture
def make(engine):
    """Build plants of the engine under test and close them afterwards."""
    plants = []

    def build(cell=None, **dynamics):
        base = DynamicsConfig()
        plant = make_plant(engine, cell or find_cell(), replace(base, **dynamics))
        plants.append(plant)
        return plant

    yield build
    for plant in plants:
        plant.close()


def start_above(robot, x=0.60, y=0.0, z=0.16, theta=0.0):
    """Return the configuration with the tool down at a point [m]."""
    from dovetail.poses import quat_multiply

    quat = quat_multiply(quat_about_z(theta), TOOL_DOWN)
    return robot.inverse_kinematics(Pose(np.array([x, y, z]), quat), Q_SEED)
