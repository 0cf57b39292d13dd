"""`dovetail export`: a model of Stable-Baselines3 or SBX as a policy of dovetail."""

import shlex
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from dovetail.commands.unproven import note_cell
from dovetail.envs.registered import make
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.learn.foreign import import_file
from dovetail.learn.policy import policy_files
from dovetail.learn.policy_env_config import PolicyEnvConfig, find_task
from dovetail.settings import settings


@settings()
class Export(PolicyEnvConfig):
    """Write a model.zip of Stable-Baselines3 or SBX as a policy.

    The model does not say how its environment was set: give the settings that differ
    from the defaults. The policy is written if its actions are the model's on 256
    random observations.
    """

    model: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL.zip")]
    """The file that model.save wrote."""
    out: Path | None = None
    """Name of the policy, NAME.safetensors and NAME.json; default the model's, beside
    it."""
    trust: bool = False
    """Load the file with its library, which runs the code in it: for files of your own.
    Without it the file is only inspected."""

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
        find_task(self.env, type(self))
        env = make(self.env, **self.env_options())
        try:
            note_cell(console, require_contact_env(env).cell, None)
            policy = import_file(model, env, self, is_trusted=self.trust)
            weights = policy.save(out)
            note = policy.metadata["provenance"].get("note", "")
        finally:
            env.close()
        for file in policy_files(weights):
            line = f"written: {file}"
            console.print(line, soft_wrap=True, highlight=False, markup=False)
        words = ["dovetail", "evaluate", str(weights), "--twin", "medium"]
        if note:
            console.print(note, soft_wrap=True, highlight=False, markup=False)
        line = f"next: {shlex.join(words)}"
        console.print(line, soft_wrap=True, highlight=False, markup=False)
        return 0


COMMON = (
    *("model", "out", "trust", "env", "task_options", "task", "f_scale"),
    *("force_damping", "theta_range", "near_speed", "near_press"),
    *("period", "max_steps", "also", "recall", "stack", "robot", "cell"),
)
"""Settings that `--help` lists."""
