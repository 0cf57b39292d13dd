"""Play a recording's Targets in a simulation, closed loop, and compare.

A replay runs the C++ controller against the engine, whose loop is in C++ too. MuJoCo's
`mujoco.batch` steps many simulations at once but with controls given beforehand; here
each torque depends on the cycle before, so a replay is one simulation, and populations
are spread over processes.
"""

from dataclasses import replace

import numpy as np

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.target_columns import target_of
from dovetail.errors import PlantError
from dovetail.identify.parameters import nominal_model
from dovetail.identify.recording import Recording, Sequence
from dovetail.plants.plant import COLUMN
from dovetail.plants.twin import Twin, make_twin
from dovetail.robots.links import InertiaSet
from dovetail.types import Array
from dovetail.workcell.workcell import Workcell

_OTHER = "lbr"
"""Name under which a plant takes links that are no published set: not the model's."""
DIVERGED = 10.0
"""Error of a model whose simulation diverges [m]: worse than anything in reach."""


class LogReplay:
    """The recording's controller, Targets and starts, over any model."""

    def __init__(self, recording: Recording, engine: str = "mujoco") -> None:
        """Build controller and plant once; each run changes the dynamics alone.

        Args:
            recording: What was played, and what came of it.
            engine: Physics engine, "mujoco", "bullet" or "drake"; a model's own is not
                used.

        Raises:
            ConfigError: An unknown engine, or settings out of range.
            MissingDependencyError: The engine is not installed.
        """
        self.recording = recording
        self.engine = engine
        cell = recording.cell
        self._robot = cell.loaded_robot()
        self._plant = make_twin(nominal_model().on(cell.robot), cell, engine=engine)
        self._controller = make_controller(
            self._robot, *recording.settings(), recording.task, recording.period
        )
        self._targets = [
            [target_of(row) for row in s.targets] for s in recording.sequences
        ]
        self._measured = np.concatenate(recording.positions())

    def run(self, model: Twin, links: InertiaSet | None = None) -> list[Array]:
        """Play every sequence on a model.

        Args:
            model: Dynamics, command delay and noise.
            links: Bodies of the bare arm's links in place of the model's inertia set.

        Returns:
            The TCP at each cycle [m], one array of shape (cycles, 3) per sequence.

        Raises:
            PlantError: The simulation diverged.
        """
        cell = self.recording.cell
        model = model.on(cell.robot)
        if links is not None:
            cell, model = _with_links(cell, links), replace(model, inertia=_OTHER)
        self._plant.cell = cell
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
        plant.reset(sequence.q_start, self.recording.fixture)
        hold = self._robot.tool_pose(sequence.q_commanded)
        self._controller.reset(plant.read()[0], hold.position, hold.quat_wxyz)
        logs = [
            plant.run_cycles(self._controller, target, cycles, period)[0]
            for target, cycles in zip(targets, sequence.cycles, strict=True)
        ]
        return np.vstack(logs)[:, COLUMN["x"] : COLUMN["z"] + 1]

    def error(self, model: Twin) -> Array | None:
        """Return the simulated minus the recorded TCP [m].

        Returns:
            Shape (cycles of all sequences, 3); None where the simulation diverges.
        """
        try:
            error = np.concatenate(self.run(model)) - self._measured
        except PlantError:
            return None
        return error if np.isfinite(error).all() else None

    def rms(self, model: Twin) -> float:
        """Return the root mean square distance of the TCP from the recording [m].

        It is taken over all cycles of all sequences, and at most `DIVERGED`, which it
        is where the simulation diverges.
        """
        return rms_of(self.error(model))

    def close(self) -> None:
        """Release the engine; harmless when repeated."""
        self._plant.close()


def _with_links(cell: Workcell, links: InertiaSet) -> Workcell:
    """Return the cell with an arm that has these links as its set `_OTHER`."""
    published = replace(cell.robot.links, inertia_sets={_OTHER: links})
    return replace(cell, robot=replace(cell.robot, links=published))


def rms_of(error: Array | None) -> float:
    """Return the root mean square length of the rows of an error, see `Replay.error`.

    Args:
        error: Shape (cycles, 3) [m]; None is a simulation that diverged.
    """
    if error is None:
        return DIVERGED
    return min(float(np.sqrt((error**2).sum(axis=1).mean())), DIVERGED)
