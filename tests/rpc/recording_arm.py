"""An arm in real time, without physics: it records calls, and a stop ends its step."""

import threading
import time

import numpy as np

from dovetail.arms.arm import ArmState, ToolState
from dovetail.arms.arm_address import ArmAddress
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.rpc.offered_arm import OfferedArm


class RecordingArm:
    """Steps take as long as they say; `trouble` is raised by the next step."""

    def __init__(self, robot, period):
        self.robot, self.period = robot, period
        self.calls = []
        self.trouble = None
        self.stopped_at = None
        self._stop = threading.Event()
        self._stamp = 0.0

    def reset(self, q, hole):
        self.calls.append("reset")
        self._stop.clear()
        self._stamp = 0.0
        return self._state(0)

    def step(self, target, duration=0.05):
        self.calls.append("step")
        if self.trouble is not None:
            trouble, self.trouble = self.trouble, None
            raise trouble
        self._stop.wait(duration)
        self._stamp += duration
        return self._state(round(duration / self.period))

    def stop(self):
        self.calls.append("stop")
        self.stopped_at = time.monotonic()
        self._stop.set()

    def clear(self):
        self.calls.append("clear")
        self._stop.clear()

    def statistics(self):
        return {"notes": []}

    def seed(self, seed):
        self.calls.append(f"seed {seed}")

    def close(self):
        self.calls.append("close")

    def _state(self, cycles):
        log = np.zeros((cycles, len(CYCLE_COLUMNS)))
        log[:, 0] = self._stamp + self.period * np.arange(cycles)
        none = np.full(3, np.nan)
        quat = np.array([0.0, 1.0, 0.0, 0.0])
        return ArmState(
            *(self._stamp, np.zeros(7), np.zeros(7)),
            *(ToolState(np.zeros(3), quat, np.zeros(6)), none, np.zeros(6), 0, log),
        )


class RecordingAddress(ArmAddress):
    """Of an arm that moves in real time."""

    def build(self, cell, settings):
        return RecordingArm(cell.loaded_robot(), settings.period)

    def describe_ground(self):
        return "a recording"


class RecordingOffer(OfferedArm):
    """Keeps the settings that it was built with."""

    def __init__(self, cell):
        super().__init__(RecordingAddress(text="recording"), cell)
        self.built = []

    def build(self, settings):
        self.built.append(settings)
        return super().build(settings)
