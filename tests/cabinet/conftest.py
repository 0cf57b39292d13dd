"""Cabinets over a light plant, and scripted clients."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.cabinet.cabinet import Cabinet
from dovetail.cabinet.config import CabinetConfig, Endpoint
from dovetail.envs.registered import find_cell
from dovetail.plants.plant import DynamicsConfig
from dovetail.poses import Pose, quat_about_z

from .client import Client

FIXTURE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
Q_START = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.5])


class LightPlant:
    """Seven free masses: a plant whose motion can be computed by hand."""

    inertia = 2.0

    def __init__(self):
        self.cell = find_cell()
        self.robot = self.cell.loaded_robot()
        self.dynamics = DynamicsConfig()
        self.applied = []
        self.fixture = None
        self.reset(Q_START, FIXTURE)

    def reset(self, q, fixture):
        self.cell.require_reachable(fixture)
        self.is_braked = False
        self.q, self.dq, self.fixture = np.array(q, dtype=float), np.zeros(7), fixture

    grasped = None

    def grasp(self, offset):
        self.grasped = offset

    def move_fixture(self, fixture):
        self.cell.require_reachable(fixture)
        self.fixture = fixture

    def read(self):
        return self.q.copy(), self.dq.copy()

    command_delay = 0.0

    def apply(self, tau, dt, drive=None):
        tau = np.array(tau) if drive is None else np.add(tau, drive)
        self.applied.append((tau, dt))
        self.dq = self.dq + tau / self.inertia * dt
        if self.is_braked:
            self.dq = np.zeros(7)
        self.q = self.q + self.dq * dt

    def drop_commands(self):
        pass

    def close_brakes(self, torque):
        self.is_braked = True

    def open_brakes(self):
        self.is_braked = False

    def contact_force_peak(self):
        return np.array([0.0, 0.0, float(len(self.applied))])

    def tool_pose(self):
        return self.robot.tool_pose(self.q)

    def seed(self, seed):
        self.noise_seed = seed

    def close(self):
        pass


@pytest.fixture
def rng():
    return np.random.default_rng(1)


@pytest.fixture
def client():
    client = Client()
    yield client
    client.close()


@pytest.fixture
def make(client):
    """Build cabinets for the client; they are closed afterwards."""
    cabinets = []

    def build(plant=None, *, faults=None, script=(), log=None, to=None, **changes):
        config = CabinetConfig(
            bind=Endpoint("127.0.0.1", 0),
            control=Endpoint("127.0.0.1", 0),
            client=Endpoint(*(to or client.address)),
            clock="lockstep",
        )
        cabinet = Cabinet(
            plant or LightPlant(),
            replace(config, **changes),
            faults=faults,
            script=script,
            log=log,
        )
        cabinets.append(cabinet)
        return cabinet

    yield build
    for cabinet in cabinets:
        cabinet.close()
