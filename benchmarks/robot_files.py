"""Read robot files, and say of each what is chosen for it or why it is refused.

    python benchmarks/robot_files.py [--env ID] [--short N] FILE_OR_FOLDER...

A folder stands for every URDF below it, and every MJCF file with a body of its own.
Each file is read as `--robot FILE` reads it, and put into the cell of a task. A row has
the file, the result (reads, weak or refused), and the notes or the reason.
"""

import argparse
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from dovetail.envs.registered import find_cell, make_task
from dovetail.errors import DovetailError, TorqueError
from dovetail.robots.find import find_robot
from dovetail.tasks.shipped import DEFAULT_ENV


def list_files(paths: list[Path]) -> Iterator[Path]:
    """Yield the robot files that paths stand for."""
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        yield from sorted(path.rglob("*.urdf"))
        for file in sorted(path.rglob("*.xml")):
            head = file.read_text(encoding="utf-8", errors="replace")
            if "<mujoco" in head and "<body" in head:
                yield file


def judge(path: Path, env_id: str) -> tuple[str, str]:
    """Return the result of a file, and its notes or the reason of a refusal."""
    try:
        robot = find_robot(str(path))
    except DovetailError as error:
        return "refused", str(error).removeprefix(f"{path} ").removeprefix(f"{path}: ")
    try:
        cell = find_cell(env_id, str(path))
        for place in make_task(env_id, {}).trial_poses:
            cell.require_reachable(place.pose())
    except TorqueError as error:
        return "weak", str(error)
    except DovetailError as error:
        return "out of reach", str(error)
    notes = (*cell.robot.notes, *robot.motors.notes)
    return f"reads, {cell.robot.gripper}", "; ".join(notes) or "nothing to say"


def main() -> None:
    """Print a row for each file, and how many there are of each result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", nargs="+", type=Path)
    parser.add_argument("--env", default=DEFAULT_ENV)
    parser.add_argument("--short", type=int, default=160, help="characters of notes")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    counts: Counter[str] = Counter()
    print("| file | result | notes |\n|---|---|---|")
    for path in list_files(given.paths):
        result, said = judge(path, given.env)
        counts[result.partition(",")[0]] += 1
        name = "/".join(path.parts[-3:])
        short = said if len(said) <= given.short else f"{said[: given.short]}..."
        print(f"| {name} | {result} | {short} |", flush=True)
    print("\n" + ", ".join(f"{count} {result}" for result, count in counts.items()))


if __name__ == "__main__":
    main()
