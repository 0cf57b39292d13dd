"""Intervals, sensitivity and confounding, on fits whose truth is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from scipy import stats

from dovetail.errors import ConfigError
from dovetail.identify.linearise import Linearisation, half_width, linearise
from dovetail.identify.parameters import KNOWN, Parameter, ParameterSet
from dovetail.identify.recorder import RecordConfig, record
from dovetail.identify.replay import LogReplay
from dovetail.identify.student import student_t
from dovetail.identify.uncertainty import KNOWN_SHARE, analyse, judge

SEQUENCES, CYCLES = 10, 60


def unit_parameters(count):
    return [Parameter(f"p{i}", "m", -1.0, 1.0, 0.0, np.inf) for i in range(count)]


def basis(rng, count):
    """Smooth motions, one column for each parameter, one block for each sequence."""
    steps = rng.normal(size=(SEQUENCES, 3 * CYCLES, count))
    return np.cumsum(steps, axis=1) / np.sqrt(CYCLES)


def wander(rng):
    """Errors that hang together within a sequence, as those of a model do."""
    steps = rng.normal(size=(SEQUENCES, 3 * CYCLES))
    return 0.01 * np.cumsum(steps, axis=1) / np.sqrt(CYCLES)


def at_optimum(motion, errors):
    """Return the least-squares fit of zero to linear motions with errors."""
    flat = motion.reshape(-1, motion.shape[2])
    vector = np.linalg.lstsq(flat, errors.ravel(), rcond=None)[0]
    return Linearisation(
        vector=vector,
        residuals=tuple(motion @ vector - errors),
        jacobians=tuple(motion),
    )


def judged(motion, errors=None):
    if errors is None:
        errors = wander(np.random.default_rng(1))
    return judge(at_optimum(motion, errors), unit_parameters(motion.shape[2]))


def with_effects(rng, moved):
    """A fit that lacks three effects, each of which moves the tool as parameters do."""
    motion = basis(rng, 2)
    effects = 0.3 * motion @ rng.normal(size=(2, 3)) + 0.1 * basis(rng, 3)
    lines = at_optimum(motion, wander(rng) + effects @ rng.normal(size=3))
    return replace(lines, unmodelled=tuple(effects) if moved else ())


@pytest.mark.parametrize(("moved", "least", "most"), [(1, 0.93, 1.0), (0, 0.0, 0.3)])
def test_effects_that_the_fit_lacks_widen_the_interval(moved, least, most):
    """The truth is zero; a jackknife alone does not know what all sequences share."""
    rng, draws, inside = np.random.default_rng(3), 100, 0
    for _ in range(draws):
        result = judge(with_effects(rng, moved), unit_parameters(2))
        for estimate in result.estimates:
            low, high = estimate.uncertainty.interval
            inside += low <= 0.0 <= high
    assert least <= inside / (2 * draws) <= most


class CurvedReplay:
    """A simulation whose motion is a known function of gravity's three numbers."""

    def __init__(self, motion, errors, curve=0.0):
        self.motion, self.curve, self.runs = motion, curve, 0
        measured = [e.reshape(-1, 3) for e in errors]
        self.recording = SimpleNamespace(positions=lambda: measured, period=0.005)

    def run(self, model):
        self.runs += 1
        value = np.array(model.gravity_residual)
        return [
            (b @ (value + self.curve * value**2)).reshape(-1, 3) for b in self.motion
        ]


@pytest.mark.parametrize("degrees", [1, 2, 3, 4, 9, 10, 49, 200])
def test_the_quantile_of_students_t_is_scipys(degrees):
    expected = stats.t.ppf(0.975, degrees)
    assert student_t(degrees) == pytest.approx(expected, rel=1e-9)


def test_the_interval_covers_the_truth_where_errors_hang_together():
    """Nominal 95 %; the white-noise interval of the same fits covers far less."""
    rng = np.random.default_rng(0)
    inside, naive, draws = 0, 0, 300
    for _ in range(draws):
        lines = at_optimum(basis(rng, 3), wander(rng))
        result = judge(lines, unit_parameters(3))
        ends = [e.uncertainty.interval for e in result.estimates]
        inside += sum(low <= 0 <= high for low, high in ends)
        J, r = np.vstack(lines.jacobians), np.concatenate(lines.residuals)
        white = np.sqrt(np.diagonal(np.linalg.inv(J.T @ J)) * (r @ r) / (len(r) - 3))
        naive += np.sum(np.abs(lines.vector) <= 1.96 * white)
    assert 0.92 <= inside / (3 * draws) <= 0.985
    assert naive / (3 * draws) < 0.5


def test_the_standard_error_is_the_jackknife_of_refits():
    rng = np.random.default_rng(2)
    motion, errors = basis(rng, 2), wander(rng)
    without = [
        at_optimum(np.delete(motion, g, axis=0), np.delete(errors, g, axis=0)).vector
        for g in range(SEQUENCES)
    ]
    apart = without - at_optimum(motion, errors).vector
    expected = np.sqrt((SEQUENCES - 1) / SEQUENCES * (apart**2).sum(axis=0))
    found = [e.uncertainty.standard_error for e in judged(motion, errors).estimates]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_the_condition_number_is_numpys_of_unit_columns():
    motion = basis(np.random.default_rng(3), 4)
    J = motion.reshape(-1, 4)
    expected = np.linalg.cond(J / np.linalg.norm(J, axis=0))
    assert judged(motion).condition_number == pytest.approx(expected, rel=1e-9)


def test_the_inflation_is_that_of_regressing_on_the_others():
    motion = basis(np.random.default_rng(4), 3)
    J = motion.reshape(-1, 3)
    rest = J[:, 1:] @ np.linalg.lstsq(J[:, 1:], J[:, 0], rcond=None)[0]
    expected = (J[:, 0] @ J[:, 0]) / np.sum((J[:, 0] - rest) ** 2)
    found = judged(motion).estimates[0].confounding.variance_inflation
    assert found == pytest.approx(expected, rel=1e-9)


def test_another_unit_of_a_parameter_changes_only_its_own_numbers():
    motion = basis(np.random.default_rng(5), 2)
    errors = wander(np.random.default_rng(6))
    metres, other = judged(motion, errors), judged(motion * [1.0, 1e3], errors)
    assert other.condition_number == pytest.approx(metres.condition_number)
    errors = [r.estimates[1].uncertainty.standard_error for r in (metres, other)]
    assert errors[1] == pytest.approx(1e-3 * errors[0])


def test_a_perfectly_confounded_pair_is_named_and_the_third_stays_known():
    motion = basis(np.random.default_rng(7), 3)
    motion[:, :, 2] = -2.0 * motion[:, :, 0]
    result = judged(motion)
    first, second, third = result.estimates
    assert result.condition_number == np.inf
    verdicts = [e.judgement.verdict for e in result.estimates]
    assert verdicts == ["confounded", "known", "confounded"]
    assert (first.confounding.partner, third.confounding.partner) == ("p2", "p0")
    assert first.confounding.correlation == pytest.approx(-1.0)
    assert first.uncertainty.standard_error == np.inf
    assert np.isfinite(second.uncertainty.standard_error)
    assert first.judgement.sentence == (
        "p0 and p2 move the tool alike, in opposite directions (correlation "
        "-1.000000): only their combination is known; its 95 % interval is +-inf m, "
        "known is up to +-0.2 m"
    )


def test_a_mixture_that_imitates_a_parameter_is_named():
    motion = basis(np.random.default_rng(8), 4)
    motion[:, :, 3] = motion[:, :, 0] + motion[:, :, 1]
    sentence = judged(motion).estimates[3].judgement.sentence
    assert "p3 and a mixture of p0 and p1 move the tool alike" in sentence


def test_what_only_a_perfect_log_tells_apart_is_known_with_a_warning():
    motion = basis(np.random.default_rng(9), 2)
    motion[:, :, 1] = motion[:, :, 0] + 1e-3 * motion[:, :, 1]
    estimate = judged(motion, 1e-6 * wander(np.random.default_rng(1))).estimates[0]
    sentence = estimate.judgement.sentence
    assert estimate.judgement.verdict == "known"
    assert "although p0 and p1 move the tool alike" in sentence
    assert "a log that fits less closely will not tell them apart" in sentence


def half_of(estimate):
    low, high = estimate.uncertainty.interval
    return (high - low) / 2.0


@pytest.mark.parametrize("name", KNOWN)
def test_a_value_is_known_by_its_interval_over_its_usual_range_and_nothing_else(name):
    """The same rule for every parameter, on both sides of the border."""
    usual = replace(KNOWN[name], spread=np.inf)
    limit = KNOWN_SHARE * (usual.high - usual.low)
    motion, errors = (
        basis(np.random.default_rng(10), 1),
        wander(np.random.default_rng(1)),
    )
    once = half_of(judge(at_optimum(motion, errors), [usual]).estimates[0])
    for share, verdict in (
        (0.5, "known"), (0.999, "known"), (1.001, "undetermined"),
        (4.0, "undetermined"), (4.999, "undetermined"), (5.001, "undetermined"),
    ):  # fmt: skip
        lines = at_optimum(motion, errors * share * limit / once)
        # where the search was allowed to look makes nothing known
        for bounds in (usual, replace(usual, low=-1e3, high=1e3)):
            estimate = judge(lines, [bounds]).estimates[0]
            assert half_of(estimate) == pytest.approx(share * limit)
            assert estimate.judgement.verdict == verdict


def test_an_interval_that_is_too_wide_is_said_with_what_would_be_known():
    motion = 1e-3 * basis(np.random.default_rng(10), 1)
    estimate = judged(motion, 100.0 * wander(np.random.default_rng(1))).estimates[0]
    assert estimate.judgement.verdict == "undetermined"
    assert "known is up to +-0.2 m" in estimate.judgement.sentence


def test_a_parameter_without_effect_is_named_with_its_sensitivity():
    motion = basis(np.random.default_rng(11), 2)
    motion[:, :, 1] = 1e-8
    alive, dead = judged(motion).estimates
    assert dead.judgement.verdict == "no effect"
    assert dead.judgement.sentence == (
        "p1 has no effect on this log: over its whole range, -1 m to 1 m, the tool "
        "moves by 3.5e-05 mm RMS; leave it out"
    )
    assert dead.sensitivity == pytest.approx(np.sqrt(3) * 1e-8)
    assert alive.judgement.verdict == "known"


def test_a_log_on_which_nothing_has_an_effect_says_so_of_each():
    result = judged(np.zeros((SEQUENCES, 3 * CYCLES, 2)))
    assert [e.judgement.verdict for e in result.estimates] == ["no effect"] * 2
    assert result.condition_number == np.inf


def test_the_step_that_is_left_is_the_way_to_the_optimum():
    motion = basis(np.random.default_rng(12), 2)
    lines = at_optimum(motion, wander(np.random.default_rng(12)))
    away = np.array([0.1, 0.0])
    moved = Linearisation(
        vector=lines.vector + away,
        residuals=tuple(lines.residuals + motion @ away),
        jacobians=lines.jacobians,
    )
    left = [e.step_left for e in judge(moved, unit_parameters(2)).estimates]
    np.testing.assert_allclose(left, -away, atol=1e-10)


def test_one_sequence_is_refused():
    one = Linearisation(
        vector=np.zeros(1), residuals=(np.ones(6),), jacobians=(np.ones((6, 1)),)
    )
    with pytest.raises(ConfigError, match="the log has 1 sequence; an interval needs"):
        judge(one, unit_parameters(1))


def test_the_jacobian_is_that_of_a_curved_motion():
    rng = np.random.default_rng(13)
    motion = basis(rng, 3)
    replay = CurvedReplay(motion, wander(rng), curve=0.3)
    vector = np.array([0.2, -0.4, 0.6])
    lines = linearise(replay, ParameterSet.parse("gravity"), vector)
    for found, block in zip(lines.jacobians, motion, strict=True):
        np.testing.assert_allclose(found, block * (1.0 + 0.6 * vector), rtol=1e-9)
    assert replay.runs == 7  # two for each parameter and one


def test_the_jacobian_at_a_bound_is_one_sided():
    motion = basis(np.random.default_rng(14), 3)
    replay = CurvedReplay(motion, wander(np.random.default_rng(14)))
    parameters = ParameterSet.parse("gravity")
    lines = linearise(replay, parameters, parameters.low)
    np.testing.assert_allclose(lines.jacobians[0], motion[0], rtol=1e-9)


def test_a_vector_out_of_its_bounds_is_refused_by_name():
    replay = CurvedReplay(np.zeros((2, 6, 3)), np.zeros((2, 6)))
    with pytest.raises(ConfigError, match="parameter gravity_y is 9 m/s2, its bounds"):
        linearise(replay, ParameterSet.parse("gravity"), np.array([0.0, 9.0, 0.0]))


def test_the_delay_is_moved_by_whole_physics_steps():
    assert half_width(KNOWN["command_delay"], 0.005) == pytest.approx(0.0025)
    assert half_width(KNOWN["command_delay"], 0.001) == pytest.approx(0.001)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    out = tmp_path_factory.mktemp("recording")
    config = RecordConfig(arm="twin:easy", out=out, sequences=4, steps=12)
    return record(config, Console(quiet=True))


def test_a_real_log_names_what_it_cannot_tell_apart(recording):
    """A scale of all masses weighs as gravity does; only inertia tells them apart."""
    parameters = ParameterSet.parse("gravity,mass_scale,damping")
    replay = LogReplay(recording)
    result = analyse(replay, parameters, parameters.start)
    by_name = {e.name: e for e in result.estimates}
    assert by_name["gravity_z"].confounding.partner == "mass_scale"
    assert by_name["mass_scale"].confounding.partner == "gravity_z"
    assert by_name["mass_scale"].confounding.correlation < -0.9
    assert 5.0 < result.condition_number < np.inf
    expected = replay.rms(parameters.to_model(parameters.start))
    assert result.residual_rms == pytest.approx(expected, rel=1e-9)
