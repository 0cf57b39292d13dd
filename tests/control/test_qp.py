"""The QP of one cycle equals quadprog; stopped early it gives a safe answer."""

import numpy as np
import pytest
from reference_qp import solve_qp

from dovetail import _core

TOLERANCE = 1e-6  # rad/s2


def random_problems(robot, rng, count):
    """Problems as the controller meets them; boxes may be a single point."""
    chain = robot.chain()
    for _ in range(count):
        q = rng.uniform(robot.limits.q_min, robot.limits.q_max)
        M = chain.inertia_matrix(q) + 0.05 * np.eye(7)
        A = np.array([15.0, 15, 15, 15, 20, 20, 20])
        lb, ub = -A * rng.uniform(-0.5, 1, 7), A * rng.uniform(0.5, 1, 7)
        point = rng.random(7) < 0.1
        lb = np.where(point, ub, lb)
        cu = rng.uniform(-3.0, 5.0, 3)
        cl = cu - rng.uniform(0.0, 5.0, 3) * (rng.random(3) < 0.9)
        h = chain.coriolis(q, rng.uniform(-robot.limits.dq_max, robot.limits.dq_max))
        safe = np.clip(0.0, lb, ub)
        room = rng.uniform(0.02, 1.0) * np.asarray(robot.limits.tau_max) * 0.2
        yield {
            "M": M,
            "a0": rng.normal(0, rng.choice([5, 50]), 7),
            "lb": lb,
            "ub": ub,
            "Jc": chain.jacobian(q)[:3],
            "djc": rng.normal(0, 0.5, 3),
            "cl": cl,
            "cu": cu,
            "h": h,
            "lo": M @ safe + h - room,
            "hi": M @ safe + h + room,
        }


def test_qp_equals_quadprog(robot, rng):
    active = dict.fromkeys(("upper", "lower", "wall_upper", "wall_lower", "torque"), 0)
    for p in random_problems(robot, rng, 3000):
        mine = _core.solve_qp(**p)
        assert mine.ok
        assert not mine.unsafe
        assert (mine.a >= p["lb"]).all()
        assert (mine.a <= p["ub"]).all()
        walls = (p["Jc"], p["djc"], p["cl"], p["cu"])
        torque = (p["M"], p["h"], p["lo"], p["hi"])
        theirs = solve_qp(p["M"], p["a0"], p["lb"], p["ub"], walls, torque, 1e6)
        np.testing.assert_allclose(mine.a, theirs, atol=TOLERANCE)
        for name in active:
            active[name] += getattr(mine, name) != 0
    assert min(active.values()) > 300, active


def test_what_meets_every_row_is_returned_as_it_is(robot, rng):
    for p in random_problems(robot, rng, 300):
        p["a0"] = np.clip(0.0, p["lb"], p["ub"])
        p["cl"], p["cu"] = np.full(3, -np.inf), np.full(3, np.inf)
        result = _core.solve_qp(**p)
        assert result.iterations == 0
        np.testing.assert_array_equal(result.a, p["a0"])


def test_stopped_early_the_answer_keeps_box_and_torques(robot, rng):
    early = 0
    for p in random_problems(robot, rng, 1000):
        result = _core.solve_qp(**p, max_iter=int(rng.integers(1, 6)))
        early += not result.ok
        assert (result.a >= p["lb"]).all()
        assert (result.a <= p["ub"]).all()
        assert not result.unsafe
        assert result.iterations <= 6
    assert early > 100


def test_a_box_that_excludes_the_torques_wins_and_is_flagged(robot, rng):
    for p in random_problems(robot, rng, 300):
        p["hi"] = p["M"] @ np.clip(0.0, p["lb"], p["ub"]) + p["h"] - 40.0
        p["lo"] = p["hi"] - 5.0
        result = _core.solve_qp(**p)
        assert (result.a >= p["lb"]).all()
        assert (result.a <= p["ub"]).all()
        assert result.unsafe


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_wish_that_is_no_number_gives_the_safe_answer(robot, rng, bad):
    p = next(random_problems(robot, rng, 1))
    p["a0"][3] = bad
    result = _core.solve_qp(**p)
    assert not result.ok
    np.testing.assert_array_equal(result.a, np.clip(0.0, p["lb"], p["ub"]))


@pytest.mark.parametrize("name", ["lb", "ub", "cl", "cu", "lo", "hi", "h", "djc", "Jc"])
def test_a_bound_that_is_no_number_gives_the_safe_answer(robot, rng, name):
    """A NaN compares false: a row with one counted as met, and ok said True."""
    for p in random_problems(robot, rng, 50):
        safe = np.clip(0.0, p["lb"], p["ub"])
        array = p[name] = np.array(p[name])
        array.flat[rng.integers(array.size)] = np.nan
        if name in ("lb", "ub"):
            safe = np.fmin(np.fmax(0.0, p["lb"]), p["ub"])
        result = _core.solve_qp(**p)
        assert not result.ok
        np.testing.assert_array_equal(result.a, safe)


@pytest.mark.parametrize("rho", [np.nan, 0.0, -1.0, np.inf, -np.inf])
def test_a_weight_of_walls_that_is_none_gives_the_safe_answer(robot, rng, rho):
    """Walls then weighed nothing, or were not seen, and ok said True."""
    for p in random_problems(robot, rng, 20):
        result = _core.solve_qp(**p, rho=rho)
        assert not result.ok
        np.testing.assert_array_equal(result.a, np.clip(0.0, p["lb"], p["ub"]))


@pytest.mark.parametrize(("low", "high"), [("lb", "ub"), ("cl", "cu"), ("lo", "hi")])
def test_a_bound_below_its_other_side_gives_the_safe_answer(robot, rng, low, high):
    """No point is inside, and ok said True."""
    for p in random_problems(robot, rng, 50):
        lower, upper = (p[name] for name in (low, high))
        index = rng.integers(lower.size)
        lower[index] = upper[index] + rng.uniform(0.1, 10.0)
        result = _core.solve_qp(**p)
        assert not result.ok
        np.testing.assert_array_equal(result.a, np.clip(0.0, p["lb"], p["ub"]))


@pytest.mark.parametrize("stage", ["sjs", "sjs_exact"])
@pytest.mark.parametrize("name", ["a0", "lb", "ub"])
def test_a_box_that_is_no_number_gives_rest(robot, rng, stage, name):
    p = next(random_problems(robot, rng, 1))
    box = {"a0": p["a0"], "lb": p["lb"], "ub": p["ub"]}
    box[name][2] = np.nan
    result = getattr(_core, stage)(Minv=np.linalg.inv(p["M"]), **box)
    assert not result.ok
    safe = np.fmin(np.fmax(0.0, box["lb"]), box["ub"])
    np.testing.assert_array_equal(result.a, safe)


def test_python_and_c_stop_after_the_same_number_of_changes():
    """Python's default was 60 where the controller's is 100."""
    assert "max_iter: int = 100" in str(_core.solve_qp.__doc__)
