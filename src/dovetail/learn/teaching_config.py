"""Settings of a training's start: from a policy, demonstrations or a teacher."""

from typing import Annotated

from dovetail.options import some_paths
from dovetail.settings import Range, settings


@settings()
class TeachingConfig:
    """Start from a policy, demonstrations or a teacher."""

    from_policy: str | None = None
    """Policy to start from: a file, or the name of a shipped one. For the first
    `learning_starts` steps only the critics learn; then the actor does at a tenth of
    their rate, and goes back to the one whose episodes went best if its own go badly.
    The best one is what the run ends with."""
    demos: Annotated[tuple[str, ...], some_paths("--demos")] = ()
    """Episode logs, or folders of them, whose steps are in every batch. See `pretrain`.
    By a person or any policy, of the same task, robot and meaning of an action."""
    pretrain: Annotated[int | None, Range(0, 1e6, "steps")] = None
    """Gradient steps from demonstrations alone, before the first action.
    2000 with `demos`, 0 without or from a policy. After them the policy's own actions
    take the place of random ones."""
    teacher: str = "none"
    """Actor of the first `learning_starts` steps: none, corner, or logs. None is
    chance; corner the scripted search, with noise; logs are as `demos`."""
    teacher_noise: Annotated[float, Range(0.0, 1.0, "1")] = 0.08
    """Standard deviation of the noise on a teacher's actions [1]."""
    teacher_share: Annotated[float | None, Range(0.0, 1.0, "1")] = None
    """Share of each batch that was shown [1]: 0.5, after `pretrain` 0.2. The teacher
    or `demos` show it; what was learned from them already needs less of them."""
    learning_starts: Annotated[int, Range(0, 1e9, "steps")] = 1000
    """Random actions before the first gradient step (not ppo, gps).
    See `from_policy`."""

    @property
    def first_updates(self) -> int:
        """Gradient steps before the first action."""
        return self.pretrain or 0

    @property
    def has_teacher(self) -> bool:
        """True if the scripted search acts in the first steps."""
        return self.teacher == "corner"

    @property
    def logs(self) -> tuple[str, ...]:
        """Episode logs that are in every batch."""
        is_log = self.teacher not in ("none", "corner")
        return (*self.demos, *((self.teacher,) if is_log else ()))
