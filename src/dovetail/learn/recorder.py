"""The callback that Stable-Baselines3 calls on every step of a run."""

from collections.abc import Callable
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback  # noqa: TID253

from dovetail.learn.best_actor import BestActor
from dovetail.learn.early_stopping import EarlyStopping
from dovetail.learn.progress import EpisodeLog, EpisodeRow, Report, Stopwatch

_REPORT_INTERVAL = 100


class Recorder(BaseCallback):
    """Keeps progress.csv, feeds bar and TensorBoard, and asks for checkpoints."""

    def __init__(
        self,
        log: EpisodeLog,
        watch: Stopwatch,
        report: Report,
        checkpoint: Callable[[], object],
        interval: int,
        stop: EarlyStopping,
        test: Callable[[], bool],
        best: BestActor | None = None,
    ) -> None:
        """Take what to write to.

        Args:
            log: Finished episodes.
            watch: Training time.
            report: Told now and then where the run stands.
            checkpoint: Writes a checkpoint of the model as it is.
            interval: Environment steps between two checkpoints.
            stop: Says when a test is due.
            test: Makes one of the model as it is, and says if it is passed.
            best: Judges the actor of a run that started from a policy.
        """
        super().__init__()
        self._log = log
        self._watch = watch
        self._report = report
        self._checkpoint = checkpoint
        self._interval = interval
        self._stop, self._test = stop, test
        self._best = best
        self._force: list[float] = []
        self._saved = self._reported = 0

    def _on_training_start(self) -> None:
        self._force = [0.0] * self.training_env.num_envs
        self._saved = self._reported = self.num_timesteps

    def _on_step(self) -> bool:
        infos, dones = self.locals["infos"], self.locals["dones"]
        for i, (info, done) in enumerate(zip(infos, dones, strict=True)):
            force = float(info["contact_force_max"])
            self._force[i] = float(np.maximum(self._force[i], force))  # nan stays
            if done:
                self._finish(info, self._force[i])
                self._force[i] = 0.0
        step = self.num_timesteps
        if step - self._reported >= _REPORT_INTERVAL:
            self._reported = step
            rate, is_steady = self._watch.speed(step)
            self._tell(rate=rate, is_steady=is_steady)
        if not self._stop.is_due(step):
            return True
        self._tell(phase="testing")
        is_passed = self._test()
        self._tell()
        return not is_passed

    def _tell(self, **more: Any) -> None:
        step = self.num_timesteps
        status = self._log.status(step, 0.0)
        self._report(status._replace(stage=self._stop.stage(step), **more))

    def _finish(self, info: dict[str, Any], force: float) -> None:
        row = EpisodeRow(
            step=self.num_timesteps,
            reward=float(info["episode"]["r"]),
            length=int(info["episode"]["l"]),
            success=int(info["success"]),
            contact_force_max=force,
            wall_time=self._watch.elapsed(),
        )
        self._log.add(row)
        self._stop.note(row)
        if self._best is not None:
            self._best.add(row.reward)
        status = self._log.status(self.num_timesteps, 0.0)
        self.logger.record("rollout/success_rate", status.success)
        self.logger.record_mean("rollout/contact_force_max", force)

    def _on_rollout_start(self) -> None:
        """Save here: every transition so far is stored and has been learned from."""
        if self._best is not None:
            self._best.judge(self.num_timesteps)
        if self.num_timesteps - self._saved >= self._interval:
            self._saved = self.num_timesteps
            self._checkpoint()

    def _on_training_end(self) -> None:
        if self._best is not None:
            self._best.judge(self.num_timesteps)
            self._best.finish()
