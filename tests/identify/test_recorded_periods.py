"""A recording at any control period is replayed and fitted at its own."""

from dataclasses import replace

import pytest

from dovetail.control.period import PERIODS
from dovetail.errors import LogError
from dovetail.identify.fit import FitConfig, fit
from dovetail.identify.hidden_delay import hidden_delay
from dovetail.identify.parameters import nominal_model
from dovetail.identify.recorder import RecordConfig, record
from dovetail.identify.recording import Recording
from dovetail.identify.replay import LogReplay
from dovetail.identify.report import write_identification_report
from dovetail.plants.twin import load_twin
from extras import need

DELAY = 0.005
PLANTED = {"gravity_residual": (0.0, 0.0, 0.15), "damping": (0.8,) * 7}
STEPS = 8
NOT_OF_FRI = 0.0025  # s


@pytest.fixture(scope="module", params=PERIODS, ids="{:g}s".format)
def planted(request, tmp_path_factory, quiet):
    """A recording of a late arm with planted parameters, and that arm's file."""
    folder = tmp_path_factory.mktemp("period")
    file = folder / "planted.toml"
    late = replace(nominal_model(), command_delay=DELAY, **PLANTED)
    file.write_text(late.to_toml())
    config = RecordConfig(
        arm=f"twin:{file}",
        out=folder / "log",
        period=request.param,
        sequences=2,
        steps=STEPS,
    )
    recording = record(config, quiet)
    assert recording.period == request.param
    return recording, file, folder / "log"


def test_a_replay_is_at_the_period_of_the_recording(planted):
    recording, file, _ = planted
    cycles = round(0.05 / recording.period)
    assert {len(s.log) for s in recording.sequences} == {STEPS * cycles}
    replay = LogReplay(recording)
    assert replay.rms(load_twin(file)) < 1e-12
    assert replay.rms(nominal_model()) > 2e-4  # m
    replay.close()


def test_the_delay_is_found_at_every_period(planted):
    recording, file, _ = planted
    replay = LogReplay(recording)
    punctual = replace(load_twin(file), command_delay=0.0)
    assert hidden_delay(replay, punctual) == pytest.approx(DELAY, abs=1.1e-3)
    assert hidden_delay(replay, load_twin(file)) == 0.0
    replay.close()


def test_planted_parameters_are_recovered_at_every_period(planted, quiet, tmp_path):
    need("cmaes")
    _, _, log = planted
    config = FitConfig(
        log=log,
        out=tmp_path / "fit",
        parameters="gravity_z,damping,command_delay",
        workers=1,
        evaluations=32,
    )
    result = fit(config, quiet)
    gravity, damping, delay = result.vector
    assert delay == pytest.approx(DELAY, abs=5e-4)
    assert gravity == pytest.approx(0.15, abs=0.02)
    assert damping == pytest.approx(0.8, rel=0.05)
    assert result.rms_after < 0.02 * result.rms_before
    assert load_twin(tmp_path / "fit/model.toml").command_delay == delay


@pytest.mark.parametrize("planted", [NOT_OF_FRI], indirect=True)
def test_the_report_reads_a_log_of_any_period(planted, quiet, tmp_path):
    need("cmaes")
    _, _, log = planted
    out = tmp_path / "fit"
    config = FitConfig(
        log=log, out=out, parameters="gravity_z", workers=1, evaluations=8
    )
    fit(config, quiet)
    write_identification_report(out, None, tmp_path / "report", quiet)
    assert "0.0025" in (tmp_path / "report/report.html").read_text()


OTHERS = [period for period in PERIODS if period != 0.005]


@pytest.mark.parametrize("planted", OTHERS, indirect=True)
def test_recordings_of_two_periods_are_not_compared(planted, folder):
    recording, _, _ = planted
    with pytest.raises(LogError, match="differ in period"):
        recording.require_like(Recording.load(folder))
