"""Environments that also show the truth, for critics; the actor does not look at it.

How long a search takes depends on where the fixture is far more than on any one action.
A critic that knows where it is can tell what the action was worth.

Reference:
    Pinto et al. 2018, Asymmetric actor critic for image-based robot learning.
"""

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnvWrapper  # noqa: TID253

from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.observation import POSITION_SCALE, THETA_SCALE
from dovetail.envs.unwrapped import require_contact_env
from dovetail.poses import UNMOVED, rotation_error, theta_about_vertical

_FARTHEST = 7.0
"""Bound of the scaled numbers, see `envs.observation`."""


class PrivilegedCritic(VecEnvWrapper):
    """Appends to each observation how far the fixture is from where it is believed.

    These are x, y, z in world axes and the turn about the vertical, scaled as where
    the tool is; where the held part may be displaced, its place and rotation vector in
    the tool; and which of several kinds of episode it is, a one among zeros.
    """

    def __init__(self, venv: Any, kinds: NDArray[np.float32]) -> None:
        """Wrap environments.

        Args:
            venv: Vector environment of dovetail's environments.
            kinds: Further numbers of each environment, shape (environments, numbers).
        """
        box = venv.observation_space
        self._cores = [require_contact_env(env) for env in venv.envs]
        self._slips = any(any(core.grasp_range) for core in self._cores)
        size = 10 if self._slips else 4
        high = np.full(size + kinds.shape[1], _FARTHEST, dtype=np.float32)
        whole = np.concatenate([box.high, high])
        super().__init__(venv, gymnasium.spaces.Box(-whole, whole, dtype=np.float32))
        self._kinds = kinds
        self._truth = np.zeros((len(self._cores), size), dtype=np.float32)

    def reset(self) -> NDArray[np.float32]:
        """Start an episode in each."""
        return self._told(self.venv.reset())

    def step_wait(self) -> Any:
        """End the steps; an episode's last observation has that episode's truth."""
        before = self._truth
        seen, rewards, dones, infos = self.venv.step_wait()
        for i in np.flatnonzero(dones):
            last = infos[i]["terminal_observation"]
            told = [last, before[i], self._kinds[i]]
            infos[i]["terminal_observation"] = np.concatenate(told)
        return self._told(seen), rewards, dones, infos

    def _told(self, seen: Any) -> NDArray[np.float32]:
        self._truth = np.array([_truth(c, slips=self._slips) for c in self._cores])
        return np.hstack([seen, self._truth, self._kinds])


def _truth(core: ContactEnv, *, slips: bool) -> NDArray[np.float32]:
    true, seen = core.fixture, core.tracker.estimate().pose
    turn = theta_about_vertical(true.quat_wxyz, seen.quat_wxyz)
    off = np.append(
        (true.position - seen.position) / POSITION_SCALE, turn / THETA_SCALE
    )
    if slips:
        part, still = core.grasp, UNMOVED.quat_wxyz
        turned = rotation_error(part.quat_wxyz, still) / THETA_SCALE
        off = np.concatenate([off, part.position / POSITION_SCALE, turned])
    scaled = np.sign(off) * np.log1p(np.abs(off))
    return scaled.clip(-_FARTHEST, _FARTHEST).astype(np.float32)
