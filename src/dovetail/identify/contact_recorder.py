"""Record slides on a plain surface, from which a fit learns contact."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track

from dovetail.arms.arm import ArmState
from dovetail.envs.contact_env import ContactEnv
from dovetail.identify.contact_log import contact_path, save_strip
from dovetail.identify.contact_motion import START, play_strip
from dovetail.identify.gapless import play_gapless
from dovetail.identify.plain_strip import Strip
from dovetail.plants.plant import COLUMN
from dovetail.poses import Pose
from dovetail.types import Vec7

_SEED = 900
"""Of the first strip's noise, beside the sequences' own."""


def record_contact(
    env: ContactEnv,
    strips: Sequence[Strip],
    place: Pose,
    folder: Path,
    metadata: Mapping[str, Any],
    console: Console,
) -> None:
    """Slide the held part on each strip whose file is missing, and write it.

    Args:
        env: Its arm slides.
        strips: Where.
        place: Pose of the fixture.
        folder: Of the recording.
        metadata: Content of its `recording.json`.
        console: Where progress goes.

    Raises:
        ArmError: The arm, or there is no surface.
    """
    paths = [contact_path(folder, number) for number in range(len(strips))]
    left = [number for number, path in enumerate(paths) if not path.is_file()]
    for number in track(left, "sliding in contact", console=console):
        strip = strips[number]
        start = _start(env, strip)
        seed = 1000 * int(metadata["excitation"]["seed"]) + _SEED + number

        def begin(start: Vec7 = start, seed: int = seed) -> ArmState:
            env.reset(seed=seed, options={"fixture": place, "start": start})
            return env.state

        slides = play_gapless(
            partial(play_strip, begin, env.arm, strip),
            lambda played: [slide.log[:, COLUMN["time"]] for slide in played],
            env.arm.facts.period,
            f"contact strip {number}",
        )
        save_strip(paths[number], metadata, strip, slides)


def _start(env: ContactEnv, strip: Strip) -> Vec7:
    """Return the configuration over a strip's middle [rad]."""
    robot = env.arm.facts.robot
    over = Pose(strip.middle + START * strip.normal, strip.quat_wxyz)
    return robot.inverse_kinematics(over, robot.posture(env.task.posture))
