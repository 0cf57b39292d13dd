"""libfranka over an exact arm; it keeps Python's lock while it waits.

For the process of a Franka's loop, which imports it by its name. The host says what is
wrong with the arm.
"""

import ctypes
import time
from types import SimpleNamespace

import numpy as np

from dovetail import _core
from dovetail.robots.fr3 import fr3
from dovetail.robots.missed_load import load_torques

ROBOT = fr3()
HAND, HAND_COM = 0.73, (-0.01, 0.0, 0.03)  # as Desk knows it
HAND_INERTIA = [0.001, 0.0, 0.0, 0.0, 0.0025, 0.0, 0.0, 0.0, 0.0017]
HANGS_COM = np.array([0.0, 0.0, 0.1])
HANGS = {"127.0.0.4": 2.0, "127.0.0.6": 2.0}
"""What hangs at the flange beyond what the arm compensates [kg]."""
BLIND = ("127.0.0.6",)
"""The sensors of these measure nothing."""
DESK = {"127.0.0.5": 2.73, "127.0.0.7": 0.0}
"""Mass of the end effector that Desk knows, where it is another one [kg]."""
CUT = {"127.0.0.8": 200}
"""Cycles after which nothing is heard of these any more."""
HANGS_AT = {"127.0.0.9": 200}
"""Cycles after which reading the state of these does not return."""
SLEEP = ctypes.PyDLL(None).usleep  # PyDLL: the lock is kept


class NetworkException(RuntimeError):  # noqa: N818
    pass


class ControlException(RuntimeError):  # noqa: N818
    pass


class CommandException(RuntimeError):  # noqa: N818
    pass


class RealtimeConfig:
    kIgnore = 0  # noqa: N815


class Torques:
    def __init__(self, tau):
        self.tau = tau
        self.motion_finished = False


class Robot:
    def __init__(self, host, _realtime):
        if host == "127.0.0.2":
            raise NetworkException("libfranka: Connection timeout")
        self.mode = "UserStopped" if host == "127.0.0.3" else "Idle"
        motors = ROBOT.motors
        self.plant = _core.RigidPlant(
            ROBOT.chain(), damping=motors.damping, armature=motors.armature
        )
        self.plant.reset(ROBOT.posture("down"), np.zeros(7))
        self.tau = np.zeros(7)
        self.ticks = 0
        self.hangs = HANGS.get(host, 0.0)
        self.cut, self.hangs_at = CUT.get(host), HANGS_AT.get(host)
        self.noise = np.random.default_rng(0)
        self.scale = 0.0 if host in BLIND else 0.05
        self.hand = DESK.get(host, HAND)
        self.load, self.load_com = 0.0, np.zeros(3)

    def moments(self):
        """Return mass and mass times centre of what the arm compensates."""
        both = self.hand * np.array(HAND_COM) + self.load * self.load_com
        return np.array([self.hand + self.load, *both])

    def missed(self, q):
        if not self.hangs:
            return np.zeros(7)
        return load_torques(ROBOT, q) @ (self.hangs * np.array([1.0, *HANGS_COM]))

    def gravity(self, state):
        q = np.array(state.q)
        return ROBOT.chain().gravity(q) + load_torques(ROBOT, q) @ self.moments()

    def load_model(self):
        return self

    def read_once(self):
        q, dq = self.plant.read()
        state = SimpleNamespace(
            q=q.tolist(),
            dq=dq.tolist(),
            tau_J_d=self.tau.tolist(),
            robot_mode=SimpleNamespace(name=self.mode),
            control_command_success_rate=1.0,
        )
        if self.ticks:
            return state
        missed, noise = self.missed(q), self.scale * self.noise.standard_normal(7)
        seen = self.scale > 0.0
        mass, *moment = self.moments()
        state.tau_ext_hat_filtered = seen * missed + noise
        state.tau_J = seen * (self.gravity(state) + missed) + noise
        state.m_ee, state.m_load, state.m_total = self.hand, self.load, mass
        state.F_x_Cee, state.I_ee = list(HAND_COM), HAND_INERTIA
        state.F_x_Ctotal = np.array(moment) / max(mass, 1e-9)
        return state

    def set_load(self, mass, com, _inertia):
        self.load, self.load_com = mass, np.array(com)

    def set_collision_behavior(self, *_given):
        pass

    def start_torque_control(self):
        self.begin = time.perf_counter()
        return self

    def readOnce(self):  # noqa: N802
        if self.ticks == self.cut:
            raise NetworkException("libfranka: UDP receive: Timeout")
        if self.ticks == self.hangs_at:
            time.sleep(60.0)
        before = self.ticks
        self.ticks += 1
        while (left := self.begin + 1e-3 * self.ticks - time.perf_counter()) > 0.0:
            SLEEP(int(1e6 * left))
        passed = 1e-3 * (self.ticks - before)
        return self.read_once(), SimpleNamespace(to_sec=lambda: passed)

    def writeOnce(self, command):  # noqa: N802
        self.tau = np.array(command.tau)
        left = self.missed(self.plant.read()[0]) if self.hangs else 0.0
        self.plant.apply(self.tau - left, 1e-3)
