"""Golden vectors: states and targets, and the torques that any implementation gives.

`golden.json` beside this file has the model, the settings and 24 cycles. Each is the
first after a reset at its state, with no limit at work. `--check FILE` compares torques
from elsewhere: a JSON list of 24 lists of 7 numbers [Nm], in the same order.
"""

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from dovetail import (
    Controller,
    LimitConfig,
    OscConfig,
    StepResult,
    Target,
    find_cell,
    make_controller,
    quat_multiply,
    quat_normalized,
)

FILE = Path(__file__).with_name("golden.json")
PERIOD = 0.001  # s
TASKS = ("XYZ:force A:pose BC:hold", "XYZABC:pose", "XYZ:force ABC:hold")
PER_TASK = 8
MODEL = (
    *("origin_position", "origin_rotation", "mass", "com", "inertia"),
    *("flange_position", "flange_rotation", "tool_position", "tool_rotation"),
)
FREE = {"x_min": [-2.0] * 3, "x_max": [2.0] * 3, "dx_max": [5.0] * 3}  # no walls near


def controller_of(task: str) -> Controller:
    """Return the controller of the vectors, for the modes of a task."""
    robot = find_cell().loaded_robot()
    limits = LimitConfig.for_period(robot, PERIOD, hardware=False, **FREE)
    osc = OscConfig.for_period(PERIOD, force_damping=[40.0] * 6)
    return make_controller(robot, osc, limits, task, PERIOD)


def result_of(case: dict[str, Any]) -> StepResult:
    """Return what the controller does in the first cycle after a reset at the state."""
    q, dq = np.array(case["q"]), np.array(case["dq"])
    controller = controller_of(case["task"])
    position, quat = np.array(case["position_hold"]), np.array(case["quat_wxyz_hold"])
    controller.reset(q, position, quat, dq=dq)
    f_star, position, quat = (
        np.array(case[name]) for name in ("f_star", "position_d", "quat_wxyz_d")
    )
    return controller.step(q, dq, Target(f_star, position, quat))


def draw(rng: np.random.Generator, task: str) -> dict[str, Any]:
    """Draw a state and a target near it."""
    robot = find_cell().loaded_robot()
    q = robot.posture("down") + rng.normal(0.0, 0.2, 7)
    hold, aim = robot.tool_pose(q), robot.tool_pose(q + rng.normal(0.0, 0.02, 7))
    turn = quat_normalized(np.append(1.0, rng.normal(0.0, 0.03, 3)))
    return {
        "task": task,
        "q": q.tolist(),
        "dq": rng.normal(0.0, 0.05, 7).tolist(),
        "f_star": rng.uniform(-2.0, 2.0, 6).tolist(),
        "position_d": aim.position.tolist(),
        "quat_wxyz_d": quat_multiply(turn, hold.quat_wxyz).tolist(),
        "position_hold": hold.position.tolist(),
        "quat_wxyz_hold": hold.quat_wxyz.tolist(),
    }


def make() -> dict[str, Any]:
    """Return the content of the file: cases in which no limit is at work."""
    robot, rng = find_cell().loaded_robot(), np.random.default_rng(0)
    cases: list[dict[str, Any]] = []
    for task in TASKS:
        while sum(case["task"] == task for case in cases) < PER_TASK:
            case = draw(rng, task)
            result = result_of(case)
            if result.flags.packed == 0:
                cases.append(case | {"torque": result.tau.tolist()})
    return {
        "about": "overlay torque [Nm]: gravity is the lowest level's; docs/control.md",
        "period": PERIOD,
        "model": {name: robot.arrays()[name].tolist() for name in MODEL},
        "law": plain(OscConfig.for_period(PERIOD, force_damping=[40.0] * 6)),
        "limits": plain(LimitConfig.for_period(robot, PERIOD, hardware=False, **FREE)),
        "cases": cases,
    }


def plain(config: OscConfig | LimitConfig) -> dict[str, Any]:
    """Return settings as JSON knows them."""
    return {
        name: value if isinstance(value, str | bool) else np.asarray(value).tolist()
        for name, value in asdict(config).items()
    }


def text_of(content: dict[str, Any]) -> str:
    """Return JSON with a line for each entry, and for each case."""
    rows = ",\n".join(json.dumps(case) for case in content["cases"])
    rest = (f"{json.dumps(k)}: {json.dumps(v)}" for k, v in content.items())
    head = ",\n".join(line for line in rest if not line.startswith('"cases"'))
    return f'{{\n{head},\n"cases": [\n{rows}\n]\n}}\n'


def main() -> None:
    """Compare, or write the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", type=Path, help="torques of another implementation")
    parser.add_argument("--write", type=Path, help="make the vectors, into a file")
    parser.add_argument("--quick", action="store_true", help="it is quick")
    args = parser.parse_args()
    if args.write is not None:
        args.write.write_text(text_of(make()))
        return
    cases = json.loads(FILE.read_text())["cases"]
    torques = [result_of(case).tau for case in cases]
    if args.check is not None:
        torques = json.loads(args.check.read_text())
    wanted = np.array([case["torque"] for case in cases])
    errors = np.abs(np.reshape(torques, wanted.shape) - wanted).max(axis=1)
    for task in TASKS:
        worst = max(e for e, c in zip(errors, cases, strict=True) if c["task"] == task)
        print(f"{task:26} largest difference {worst:.1e} Nm")
    print("the same to 1e-8 Nm" if errors.max() < 1e-8 else "not the same")


if __name__ == "__main__":
    main()
