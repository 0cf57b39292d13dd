"""`dovetail export`: a model of Stable-Baselines3 or SBX as a policy of dovetail."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import gymnasium
import tyro
from rich.console import Console

from dovetail.commands.help_page import Groups
from dovetail.errors import ConfigError
from dovetail.learn.env_settings import EnvSettings
from dovetail.learn.foreign import import_file
from dovetail.learn.policy import policy_files

GROUPS: Groups = {
    "the model and its policy": ("model", "out"),
    "task": ("env", "task_options", "task", "max_steps"),
    "where it was trained": ("plant", "robot", "tracker", "period"),
    "what the policy sees and does": (
        *("stack", "also", "recall", "f_scale", "f_scale_angular", "theta_range"),
        *("position_range", "force_damping", "tare", "scheme", "script", "correction"),
        "fall_back",
    ),
    "near contact": ("near_distance", "near_speed", "near_press"),
}


@dataclass(frozen=True, kw_only=True)
class Export(EnvSettings):
    """Write a model.zip of Stable-Baselines3 or SBX as a policy; runs none of it.

    The model does not say how its environment was set: give the settings that differ
    from the defaults. Statistics of VecNormalize are not in the model: a policy that
    was trained on them acts wrongly.
    """

    model: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL.zip")]
    """The file that model.save wrote."""
    out: Path | None = None
    """Name of the policy, NAME.safetensors and NAME.json; default the model's, beside
    it."""

    def run(self, console: Console) -> int:
        """Export, and say what to do next."""
        model = self.model.expanduser()
        if not model.is_file():
            raise ConfigError(
                f"there is no file {model}: give the model.zip that model.save wrote; "
                "a training of dovetail has its policy already, policy.safetensors"
            )
        out = model.with_suffix("") if self.out is None else self.out.expanduser()
        for file in policy_files(out):
            if file.exists():
                raise ConfigError(f"{file} exists; choose another --out")
        _ = self.task_class
        env = gymnasium.make(self.env, disable_env_checker=True, **self.env_options())
        try:
            weights = import_file(model, env, self).save(out)
        finally:
            env.close()
        for file in policy_files(weights):
            line = f"written: {file}"
            console.print(line, soft_wrap=True, highlight=False, markup=False)
        words = ["dovetail", "evaluate", str(weights), "--twin", "medium"]
        line = f"next: {shlex.join(words)}"
        console.print(line, soft_wrap=True, highlight=False, markup=False)
        return 0
