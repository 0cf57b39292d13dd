"""Pairs of meshes in a folder as parts: time, pieces, gap, exactness, go or not.

The folder has a folder for each pair, with plug.obj and socket.obj, or .stl, .ply or
.3mf, both where they stand when assembled. AutoMate's set (Tang et al. 2024, branch
automate of isaac-sim/IsaacGymEnvs) is such a folder, in metres. One line a pair is
written as JSON into OUT/pairs.jsonl, the part into OUT/ID; a pair that has its line is
left out, so a run that was stopped goes on. At the end a table is printed.

    python benchmarks/mesh_pairs.py ~/automate --units m --out runs/automate
    python benchmarks/mesh_pairs.py ~/automate --units m --out runs/automate --speed
    python benchmarks/mesh_pairs.py ~/automate --units m --out runs/automate --press

`--speed` adds the environment's steps per second of processor time on one core while
the plug is below the mouth, pushed straight down at the fixture's true pose, over four
tries. `--press` adds how far 100 N push the inserted plug below where 5 N hold it, in
MuJoCo: how much the contacts give way.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from blind_baselines import straight

from dovetail.envs.registered import find_cell, make
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import DovetailError
from dovetail.meshes.pair import convert
from dovetail.meshes.part_folder import write_part
from dovetail.meshes.read import FORMATS, read_meshes
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.poses import TOOL_DOWN, Pose, matrix_from_quat, quat_multiply

TRIES = 4
PRESSES, PRESSED, STEP = (5.0, 100.0), 1.0, 0.005  # N, s each, s
AT_REST = 1e-5  # m in 0.1 s


def main() -> None:
    """Convert what is not converted yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--units", help="of all meshes; without it they are guessed")
    parser.add_argument("--axis", default=None, help="way in; without it it is found")
    parser.add_argument("--speed", action="store_true", help="measure steps per second")
    parser.add_argument("--press", action="store_true", help="press with 100 N")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    lines = given.out / "pairs.jsonl"
    rows = _read(lines)
    for pair in sorted(one for one in given.folder.iterdir() if one.is_dir()):
        row = rows.get(pair.name) or _convert(pair, given)
        if given.speed and row.get("go") and "steps" not in row:
            row["steps"] = _speed(given.out / pair.name / "part.toml")
        if given.press and row.get("go") and "pressed" not in row:
            row["pressed"] = _pressed(given.out / pair.name / "part.toml")
        if row != rows.get(pair.name):
            rows[pair.name] = row
            with lines.open("a") as file:
                file.write(json.dumps({"id": pair.name} | row) + "\n")
            print(_line(pair.name, row), flush=True)
    _print_table(rows)


def _read(path: Path) -> dict[str, dict[str, Any]]:
    """Return the rows that are there; a later one of a pair replaces an earlier."""
    if not path.exists():
        return {}
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    return {row.pop("id"): row for row in rows}


def _convert(pair: Path, given: argparse.Namespace) -> dict[str, Any]:
    start = time.process_time()
    try:
        both = [
            next(p for p in (pair / f"{one}.{end}" for end in FORMATS) if p.exists())
            for one in ("plug", "socket")
        ]
        meshes = read_meshes(both[0], both[1], given.units)
        found = convert(*meshes, axis=given.axis, name=pair.name)
    except (DovetailError, StopIteration) as error:
        return {"seconds": time.process_time() - start, "reasons": [str(error)]}
    row: dict[str, Any] = {
        "seconds": time.process_time() - start,
        "go": found.is_go,
        "reasons": list(found.reasons),
        "pieces": found.pieces,
        "gap": [1e3 * one for one in found.gap[:4]],
        "depth": 1e3 * found.depth,
        "through": found.is_through,
        "stalk": found.stalk is not None,
    }
    if exact := found.exactness:
        row["clearance"] = [1e3 * exact.low, 1e3 * exact.high]
        row["allowed"] = 1e3 * exact.allowed
        row["stop"] = [None if s is None else 1e3 * s for s in exact[-2:]]
        row["exact"] = not exact.why_not()
    try:
        write_part(found, given.out / pair.name)
        row["bytes"] = sum(p.stat().st_size for p in (given.out / pair.name).iterdir())
    except DovetailError as error:
        row |= {"go": False, "reasons": [*row["reasons"], str(error)]}
    return row


def _speed(part: Path) -> float:
    """Return environment steps per second while inserting, on one core."""
    env = make("dovetail/Insert-v0", part=str(part))
    core = require_contact_env(env)
    times = []
    for seed in range(TRIES):
        observation, info = env.reset(seed=seed)
        act, over = straight(core), False
        while not over:
            action = np.asarray(act(observation, info), dtype=np.float32)
            start = time.process_time()
            observation, _, ended, cut, info = env.step(action)
            spent = time.process_time() - start
            goal = core.task.goal(core.believed)
            height = float(np.asarray(info["position_error"]) @ goal.normal)
            if height < goal.surface - float(goal.normal @ goal.position):
                times.append(spent)
            over = ended or cut
    env.close()
    return len(times) / sum(times) if times else float("nan")


def _pressed(part: Path) -> float:
    """Return how far 100 N push an inserted plug below where 5 N hold it [mm]."""
    cell = find_cell("dovetail/Insert-v0", part=str(part))
    robot = cell.loaded_robot()
    down = Pose(np.array([0.6, 0.0, 0.2]), TOOL_DOWN)
    q = robot.inverse_kinematics(down, robot.posture("down"))
    tool = robot.tool_pose(q)
    quat = quat_multiply(tool.quat_wxyz, TOOL_DOWN)
    out = matrix_from_quat(quat)[:, 2]
    plant = make_plant("mujoco", cell, DynamicsConfig.of_robot(cell.robot))
    plant.reset(q, Pose(tool.position - cell.heights[1] * out, quat))
    heights = []
    for force in PRESSES:
        plant.push(-force * out)
        for _ in range(round(PRESSED / STEP)):
            plant.apply(np.zeros(7), STEP)
            heights.append(float(plant.tool_pose().position @ out))
    plant.close()
    held, at = heights[len(heights) // 2 - 1], heights[len(heights) // 2 - 20]
    is_held = abs(held - at) < AT_REST
    return 1e3 * (held - min(heights[len(heights) // 2 :])) if is_held else np.nan


def _line(name: str, row: dict[str, Any]) -> str:
    if "gap" not in row:
        return f"{name}  {row['seconds']:5.1f} s  no: {row['reasons'][0]}"
    held, fixture = row["pieces"]
    low, high = row.get("clearance", (np.nan, np.nan))
    ends = ["-" if s is None else f"{s:.3f}" for s in row.get("stop", (None, None))]
    return (
        f"{name}  {row['seconds']:5.1f} s  {held:3d} + {fixture:4d} pieces  gap "
        f"{row['gap'][1]:.2f} mm  depth {row['depth']:.1f} mm  clearance {low:+.3f} "
        f"{high:+.3f} of {row.get('allowed', np.nan):.3f} mm  end {' / '.join(ends)} mm"
        f"  {row.get('steps', np.nan):5.0f} steps/s  "
        f"{row.get('pressed', np.nan):.3f} mm pressed  "
        + ("go" if row["go"] else f"no: {'; '.join(row['reasons'])}")
    )


def _print_table(rows: dict[str, dict[str, Any]]) -> None:
    for name, row in sorted(rows.items()):
        print(_line(name, row))
    seconds = [row["seconds"] for row in rows.values() if "gap" in row]
    median, late = np.quantile(seconds, [0.5, 0.95]) if seconds else (np.nan, np.nan)
    steps = [row["steps"] for row in rows.values() if "steps" in row]
    pressed = [row["pressed"] for row in rows.values() if "pressed" in row]
    said = f"; steps/s median {np.nanmedian(steps):.0f}" if steps else ""
    if pressed:
        middle, most = np.nanmedian(pressed), np.nanmax(pressed)
        said += f"; pressed median {middle:.3f} mm, at most {most:.3f} mm"
    print(
        f"{sum(bool(row.get('exact')) for row in rows.values())} exact and "
        f"{sum(bool(row.get('go')) for row in rows.values())} go of {len(rows)} pairs; "
        f"conversion median {median:.1f} s, p95 {late:.1f} s{said}"
    )


if __name__ == "__main__":
    main()
