"""Many arms in MuJoCo whose control cycles run at the same time, on several cores."""

import os
from collections.abc import Sequence

from dovetail import _core
from dovetail.arms.arm import Arm, ArmState
from dovetail.arms.local_arm import LocalArm
from dovetail.errors import ConfigError
from dovetail.plants.mujoco_plant import MujocoPlant


class BatchArm:
    """Steps arms of this process at once, with the numbers that each has alone.

    The control cycles of one step run in C++, without Python's lock. Each arm has its
    own controller, model and simulation: they share nothing that changes.
    """

    def __init__(self, arms: Sequence[Arm], threads: int | None = None) -> None:
        """Start the threads.

        Args:
            arms: Each simulated by MuJoCo in this process.
            threads: That simulate, the calling one among them; None is one for each
                core that this process may use. More than arms are not started.

        Raises:
            ConfigError: An arm that is simulated elsewhere or twice, or no thread.
        """
        self.arms = [_require_local(i, arm) for i, arm in enumerate(arms)]
        self._plants = [_require_mujoco(i, arm) for i, arm in enumerate(self.arms)]
        if len({id(plant) for plant in self._plants}) < len(self._plants):
            raise ConfigError(
                "two of the arms are one simulation: give each an arm of its own"
            )
        if threads is not None and threads < 1:
            raise ConfigError(f"threads is {threads}; allowed: 1 and more")
        most = threads or len(os.sched_getaffinity(0))
        self.threads = min(most, len(self.arms))
        self._pool = _core.ThreadPool(len(self.arms), self.threads)

    def begin(self, index: int, target: _core.Target, duration: float = 0.05) -> None:
        """Begin the step of one arm; its `step` with the same arguments then ends it.

        What is disturbed between control cycles is not begun: `step` does all of it.

        Args:
            index: Of the arm, from 0.
            target: What it follows.
            duration: How long [s], a whole number of its control periods.

        Raises:
            ConfigError: The duration is not a whole number of periods.
            PlantError: The arm was not reset.
        """
        arm = self.arms[index]
        if arm.disturbance.is_active:
            return
        cycles = arm.count_cycles(duration)
        self._plants[index].begin_cycles(
            self._pool, index, arm.controller, target, cycles, arm.facts.period
        )

    def step(
        self, targets: Sequence[_core.Target], duration: float = 0.05
    ) -> list[ArmState]:
        """Let every arm follow its target for a duration [s].

        Raises:
            ConfigError: The duration is not a whole number of periods.
            PlantError: A simulation diverged; the others are not running any more.
        """
        try:
            for i, target in enumerate(targets):
                self.begin(i, target, duration)
            return [
                arm.step(target, duration)
                for arm, target in zip(self.arms, targets, strict=True)
            ]
        finally:
            self.drop()

    def drop(self) -> None:
        """Wait for every arm that has begun a step, and forget what came of it."""
        for plant in self._plants:
            plant.drop_cycles()

    def close(self) -> None:
        """End the threads; harmless when repeated. The arms are not closed."""
        self.drop()
        self._pool.close()


def _require_local(index: int, arm: Arm) -> LocalArm:
    if isinstance(arm, LocalArm):
        return arm
    raise ConfigError(
        f"arm {index} of the batch is of {type(arm).__name__}; a batch has simulations "
        "of this process only: give a plant or a twin"
    )


def _require_mujoco(index: int, arm: LocalArm) -> MujocoPlant:
    if isinstance(arm.plant, MujocoPlant):
        return arm.plant
    raise ConfigError(
        f"arm {index} of the batch is simulated by {type(arm.plant).__name__}; only "
        "MuJoCo simulates many at once: give plant='mujoco' (a twin: "
        "engine='mujoco'), or step one environment after the other"
    )
