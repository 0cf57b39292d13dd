"""Play a recording's actions in a simulation, closed loop, and compare."""

from typing import cast

import numpy as np

from dovetail import _core
from dovetail.arms.local_arm import LocalArm
from dovetail.envs.commands import CommandMap
from dovetail.envs.randomisation import TOOL_DOWN
from dovetail.errors import PlantError
from dovetail.identify.parameters import nominal_model
from dovetail.identify.recording import Recording, Sequence
from dovetail.plants.plant import COLUMN, Plant
from dovetail.plants.twin import TwinConfig, TwinPlant
from dovetail.poses import quat_multiply
from dovetail.types import Array

DIVERGED = 10.0
"""Error of a model whose simulation diverges [m]: worse than anything in reach."""


class Replay:
    """The recording's controller, actions and starts, over any model."""

    def __init__(self, recording: Recording, engine: str = "mujoco") -> None:
        """Build controller and plant once; each run changes the dynamics alone.

        Args:
            recording: What was played, and what came of it.
            engine: Physics engine, "mujoco" or "bullet"; a model's own is not used.

        Raises:
            ConfigError: An unknown engine, or settings out of range.
            MissingDependencyError: The engine is not installed.
        """
        self.recording = recording
        self.engine = engine
        scene = recording.scene
        robot = scene.robot()
        osc, limits = recording.settings()
        self._plant = TwinPlant(nominal_model(), scene, engine=engine)
        self._arm = LocalArm(
            cast("Plant", self._plant),
            robot,
            osc,
            limits,
            recording.task,
            recording.period,
        )
        self._targets = [self._make_targets(s) for s in recording.sequences]
        self._measured = recording.positions()

    def _make_targets(self, sequence: Sequence) -> list["_core.Target"]:
        """Return the Target of each step, as the environment made it."""
        hole = self.recording.hole
        scene = self.recording.scene
        commands = CommandMap(
            self.recording.task, **self.recording.metadata["commands"]
        )
        up = np.array([0.0, 0.0, 1.0])  # a recording's hole is never tilted
        goal = hole.position - scene.hole_depth * up
        quat = quat_multiply(hole.quat_wxyz, TOOL_DOWN)
        plane = np.append(up, self.recording.metadata["near_height"])
        targets = []
        for action in sequence.actions:
            target = _core.Target()
            target.near_plane = plane
            commands.fill(target, action.astype(np.float32), goal, quat)
            targets.append(target)
        return targets

    def run(self, model: TwinConfig) -> list[Array]:
        """Play every sequence on a model.

        Args:
            model: Dynamics and command delay; noise is used as it says.

        Returns:
            The TCP at each cycle [m], one array of shape (cycles, 3) per sequence.

        Raises:
            PlantError: The simulation diverged.
        """
        self._plant.configure(model.dynamics())
        self._plant.attach_channel(
            _core.Channel(
                delay=model.command_delay,
                torque_noise=model.torque_noise,
                position_noise=model.position_noise,
                velocity_noise=model.velocity_noise,
                seed=model.seed,
            )
        )
        pairs = zip(self.recording.sequences, self._targets, strict=True)
        return [self._play(sequence, targets) for sequence, targets in pairs]

    def _play(self, sequence: Sequence, targets: list["_core.Target"]) -> Array:
        period, plant = self.recording.period, self._plant
        self._arm.reset(sequence.q_start, self.recording.hole)
        logs = [
            plant.run_cycles(self._arm.controller, target, cycles, period)[0]
            for target, cycles in zip(targets, sequence.cycles, strict=True)
        ]
        return np.vstack(logs)[:, COLUMN["x"] : COLUMN["z"] + 1]

    def rms(self, model: TwinConfig) -> float:
        """Return the root mean square distance of the TCP from the recording [m].

        It is taken over all cycles of all sequences; `DIVERGED` where the simulation
        does.
        """
        try:
            simulated = self.run(model)
        except PlantError:
            return DIVERGED
        pairs = zip(simulated, self._measured, strict=True)
        error = np.concatenate([a - b for a, b in pairs])
        value = float(np.sqrt((error**2).sum(axis=1).mean()))
        return min(value, DIVERGED) if np.isfinite(value) else DIVERGED

    def close(self) -> None:
        """Release the engine; harmless when repeated."""
        self._plant.close()
