"""The C++ controller equals the readable NumPy one, in closed loop."""

import itertools

import numpy as np
import pytest
from reference import ReferenceController

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import MODES, TaskSpec
from dovetail.poses import quat_normalized

TOLERANCE = 1e-8  # rad/s2 and Nm
EVERY_TASK = [
    str(TaskSpec(modes)) for modes in itertools.product(range(len(MODES)), repeat=6)
]
WIDE_WALLS = {"x_min": [-1.2, -1.2, -0.5], "x_max": [1.2, 1.2, 1.6], "near_speed": 0.05}
EXACT = {**WIDE_WALLS, "hardware": False, "last_line": False}  # no judge of the motion


AT_ONCE = OscConfig(move_speed=100.0)  # of two cycles one is far from its Target


def random_target(rng, robot, q, action):
    pose = robot.tool_pose(q)
    normal = rng.normal(0.0, 1.0, 3)
    normal /= np.linalg.norm(normal)
    quat = pose.quat_wxyz + rng.normal(0.0, rng.choice([0.02, 1.0]), 4)
    target = _core.Target(
        rng.uniform(-1.0, 1.0, 6) * action * np.array([1, 1, 1, 7, 7, 7]),
        pose.position + rng.normal(0.0, 0.1, 3),
        quat_normalized(quat),
        joint_mode=bool(rng.random() < 0.25),
        q_d=q + rng.normal(0.0, 0.02 * action, 7),
    )
    if rng.random() < 0.5:
        target.velocity_d = rng.normal(0.0, 0.3, 6)
        target.acceleration_d = rng.normal(0.0, 0.1 * action, 6)
        target.age = rng.uniform(0.0, 0.15)  # a path of 0.1 s, and beyond
    if rng.random() < 0.5:
        target.stay = int(rng.integers(8))
        target.f_tare = np.append(rng.normal(0.0, 0.3, 3), np.zeros(3))
    if rng.uniform() < 0.5:
        offset = normal @ pose.position + rng.normal(0.0, 0.01)
        target.near_plane = np.append(normal, offset)
    return target


def largest_difference(
    robot, q_start, osc, limits, period, tasks, rng, cycles, is_fresh=False, force=20.0
):
    """Run each task in closed loop on the exact plant; fresh: reset in every cycle.

    Another push of up to `force` [N] in each axis every five cycles.

    Returns the worst error, how many states were compared, how many of them were at a
    limit, and how many tasks left the problem that both solve before their end.
    """
    worst, states, limited, exotic = 0.0, 0, 0, 0
    plant = _core.RigidPlant(robot.chain(), armature=limits.armature)
    for task in tasks:
        mine = ReferenceController(robot, osc, limits, task, period)
        theirs = make_controller(robot, osc, limits, task, period)
        q = q_start + rng.normal(0.0, 0.3, 7)
        q = np.clip(q, robot.limits.q_min + 0.05, robot.limits.q_max - 0.05)
        hold = robot.tool_pose(q)
        speed = rng.choice([0.02, 0.5])
        dq = rng.uniform(-speed, speed, 7) * robot.limits.dq_max
        mine.reset(q, hold.position, hold.quat_wxyz)
        theirs.reset(q, hold.position, hold.quat_wxyz, dq=dq)
        plant.reset(q, dq)
        for cycle in range(cycles):
            if cycle % 5 == 0:
                target = random_target(rng, robot, q, rng.choice([0.1, 3.0, 30.0]))
                plant.set_external_force(rng.uniform(-force, force, 3))
            q, dq = plant.read()
            if is_fresh:
                mine.reset(q, hold.position, hold.quat_wxyz)
                theirs.reset(q, hold.position, hold.quat_wxyz, dq=dq)
            theirs.believe(q, dq)  # which samples are believed is tested elsewhere
            result = theirs.step(q, dq, target)
            flags = result.flags
            if flags.unsafe or flags.qp_early or flags.implausible:
                exotic += 1
                break  # outside the problem that both solve: the next task
            tau, a, a0 = mine.step(q, dq, target)
            errors = (result.tau - tau, result.a - a, result.a0 - a0)
            worst = max(worst, *(float(np.abs(e).max()) for e in errors))
            limited += result.flags.packed != 0
            states += 1
            plant.apply(result.tau, period)
    return worst, states, limited, exotic


@pytest.mark.parametrize("scheme", ["qp", "paper"])
def test_cpp_equals_the_reference_for_every_task(robot, q_home, rng, scheme):
    limits = LimitConfig.for_period(robot, 1e-3, scheme=scheme, **EXACT)
    worst, states, limited, exotic = largest_difference(
        robot, q_home, AT_ONCE, limits, 1e-3, EVERY_TASK, rng, 2
    )
    assert worst < TOLERANCE
    assert exotic <= 4  # none seen
    assert len(EVERY_TASK) == 4096
    assert states >= 2 * (len(EVERY_TASK) - exotic)
    assert 6600 < limited < 7100


PRINTED = {"bounds": "paper-printed", "scheme": "paper", "walls": False}
LONG_TASKS = ("XYZ:force A:pose BC:hold", "XYZ:pose ABC:pose", "ZA:force XYBC:hold")
LONG = 150  # cycles


@pytest.mark.parametrize(
    ("period", "settings"),
    [
        (1e-3, {}),
        (5e-3, {}),
        (2e-3, {"scheme": "paper"}),
        (2e-3, {"scheme": "paper", "exact_sjs": True}),
        (1e-3, {"bounds": "paper-corrected"}),
        (1e-3, PRINTED),
        (1e-3, {"mid_interval": False, "walls": False}),
        (1e-3, {"estimate_rate": 0.0, "damping": 0.0, "armature": 0.0}),
        (2.5e-3, {"hardware": True}),
        (2e-3, {"hardware": True, "passive": False}),
        (2e-3, {"hardware": True, "scheme": "paper"}),
        (5e-3, {"tau_max": [250.0, 250.0, 130.0, 130.0, 60.0, 30.0, 25.0]}),
    ],
)
def test_cpp_equals_the_reference_over_long_runs(robot, q_home, rng, period, settings):
    is_fresh = settings is PRINTED  # such motion is not all believed
    osc = OscConfig.for_period(
        period,
        integral_clamp_linear=0.0 if is_fresh else 0.3,  # an arm that goes on keeps it
        integral_clamp_angular=0.0 if is_fresh else 0.3,
        use_jdot=period > 1e-3,
        use_coriolis=period > 1e-3,
        force_damping=[0.0, 1.0, 5.0, 0.0, 2.0, 0.0],
        move_speed=100.0,
    )
    limits = LimitConfig.for_period(robot, period, **({**EXACT, **settings}))
    worst, states, limited, exotic = largest_difference(
        robot, q_home, osc, limits, period, LONG_TASKS, rng, LONG, is_fresh
    )
    assert worst < TOLERANCE
    # The bounds as printed may be empty, and ask for more than the motors can give.
    assert exotic <= (2 if settings is PRINTED else 0)
    assert states >= LONG * (len(LONG_TASKS) - exotic)
    assert limited > 0.7 * states


@pytest.mark.parametrize("period", [1e-3, 5e-3])
def test_cpp_equals_the_reference_where_a_joint_is_pushed_over_its_margin(
    robot, q_home, rng, period
):
    """There the push counts in full: no more than 0.3 tau_max of it elsewhere."""
    home = robot.limits.q_max - 0.04  # the largest postures that are drawn
    limits = LimitConfig.for_period(robot, period, **{**EXACT, "hardware": True})
    worst, states, _, exotic = largest_difference(
        robot, home, OscConfig(), limits, period, LONG_TASKS, rng, LONG, force=50.0
    )
    assert worst < TOLERANCE
    assert states >= LONG * (len(LONG_TASKS) - exotic)
    assert exotic <= 1
