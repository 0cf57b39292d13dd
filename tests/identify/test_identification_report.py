"""The report of a fit: numbers, figures, verdict, and what it refuses."""

import base64
import io
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from dovetail.errors import ConfigError, LogError
from dovetail.identify.figures import draw_convergence, draw_intervals
from dovetail.identify.fit import FitConfig, fit
from dovetail.identify.fitted import Fitted
from dovetail.identify.hidden_delay import hidden_delay
from dovetail.identify.parameters import nominal_model
from dovetail.identify.recorder import RecordConfig, record
from dovetail.identify.recording import Recording
from dovetail.identify.replay import LogReplay
from dovetail.identify.report import Comparison, write_identification_report
from dovetail.identify.transfer_limit import (
    DELAY_LIMIT,
    TRANSFER_LIMIT,
    UNTARED_LIMIT,
    judge_transfer,
)
from dovetail.identify.uncertainty import (
    Confounding,
    Identifiability,
    Judgement,
    ParameterEstimate,
    Uncertainty,
)
from dovetail.plants.twin import load_twin

QUIET = Console(quiet=True)
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with two recordings, a fit of the first, and its report."""
    folder = tmp_path_factory.mktemp("identified")
    for name, seed in (("log", 0), ("other", 1)):
        settings = RecordConfig(
            arm="twin:medium", out=folder / name, seed=seed, sequences=3, steps=12
        )
        record(settings, QUIET)
    config = FitConfig(
        log=folder / "log",
        out=folder / "fit",
        parameters="gravity,damping",
        evaluations=30,
        workers=1,
    )
    fit(config, QUIET)
    held_out = Recording.load(folder / "other")
    console = Console(record=True, width=100, file=io.StringIO())
    report = write_identification_report(
        folder / "fit", held_out, folder / "report", console
    )
    return folder, report, console.export_text()


@pytest.fixture
def held_out(made):
    return Recording.load(made[0] / "other")


def test_the_errors_are_those_of_a_replay(made):
    folder, report, _ = made
    written = json.loads((folder / "report" / "report.json").read_text())["errors"]
    fitted = Fitted.load(folder / "fit")
    model = fitted.parameters.to_model(fitted.vector)
    for log, name in (("fitting log", "log"), ("held-out log", "other")):
        replay = LogReplay(Recording.load(folder / name))
        assert written[log]["rms_before"] == pytest.approx(replay.rms(nominal_model()))
        assert written[log]["rms_after"] == pytest.approx(replay.rms(model))
        assert written[log]["max_after"] >= written[log]["rms_after"]
    assert written["held-out log"]["rms_after"] < written["held-out log"]["rms_before"]
    assert [c.log for c in report.comparisons] == ["fitting log", "held-out log"]


def test_rms_and_largest_are_of_the_distance_not_of_a_coordinate():
    zero, away = np.zeros((2, 3)), np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]])
    errors = Comparison("log", [zero], [away], [zero]).errors("before")
    assert errors == pytest.approx((5.0 / np.sqrt(2.0), 5.0))


def test_every_parameter_has_value_interval_and_sentence(made):
    _, report, _ = made
    names = [e.name for e in report.identifiability.estimates]
    assert names == ["gravity_x", "gravity_y", "gravity_z", "damping"]
    written = json.loads((made[0] / "report" / "report.json").read_text())
    for row in written["parameters"]:
        low, high = row["interval"]
        assert low < row["value"] < high
        assert row["name"] in row["sentence"]
        assert row["sensitivity"] > 0.0


def without_scripts(html):
    return re.sub(r"<script[^>]*>.*?</script>", "", html, flags=re.DOTALL)


def test_the_curves_are_those_of_the_logs_and_bring_their_library_once(made):
    html = (made[0] / "report" / "report.html").read_text()
    scripts = re.findall(r"<script[^>]*>(.*?)</script>", html, flags=re.DOTALL)
    assert sum(len(script) > 1_000_000 for script in scripts) == 1
    drawn = [s for s in scripts if "Plotly.newPlot(" in s and len(s) < 1_000_000]
    assert len(drawn) == len(made[1].comparisons) == 2
    for script, comparison in zip(drawn, made[1].comparisons, strict=True):
        traces, _ = json.JSONDecoder().raw_decode(script[script.index("[{") :])
        assert [t["name"] for t in traces[::3]] == ["measured", "before", "after"]
        measured = np.concatenate(comparison.measured)
        every = 0.02 / 0.005
        np.testing.assert_allclose(
            traces[0]["y"], 1e3 * measured[:: int(every), 0], atol=1e-3
        )


def test_the_page_needs_nothing_else(made):
    text = (made[0] / "report" / "report.html").read_text()
    assert "<script src" not in text
    text = without_scripts(text)
    assert not re.search(r'(src|href)="(?!data:)', text)
    images = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    assert len(images) == 6
    assert all(base64.b64decode(image).startswith(PNG) for image in images)


def test_the_figures_lie_beside_the_page(made):
    names = {path.name for path in made[1].files}
    assert names == {
        *("before.png", "after.png", "held-out-before.png", "held-out-after.png"),
        *("intervals.png", "convergence.png", "report.html", "report.json"),
    }
    for path in made[1].files:
        assert path.suffix != ".png" or path.read_bytes().startswith(PNG)


def test_the_console_says_the_verdict_and_every_error(made):
    _, report, text = made
    flat = " ".join(text.split())
    assert f"{report.verdict.line}: {report.verdict.sentence}" in flat
    assert "held-out log" in flat
    assert "condition number" in flat


def test_the_answer_is_said_once(made):
    _, report, text = made
    html = (made[0] / "report" / "report.html").read_text()
    page = " ".join(re.sub("<[^>]*>", " ", without_scripts(html)).split())
    answer, sentence = report.verdict.line, report.verdict.sentence
    for shown in (page, " ".join(text.split())):
        assert shown.count(answer) == 1
        assert re.search(rf"\b{answer}:? {re.escape(sentence)}", shown)
    assert not sentence.startswith(answer)


def test_without_a_held_out_log_there_is_no_verdict(made, tmp_path):
    report = write_identification_report(made[0] / "fit", None, tmp_path / "r", QUIET)
    assert report.verdict.answer == "unknown"
    assert "record one with another --seed" in report.verdict.sentence
    assert len(report.comparisons) == 1
    assert not (tmp_path / "r" / "held-out-after.png").exists()


def test_a_report_is_not_overwritten(made, held_out):
    with pytest.raises(ConfigError, match="is not empty"):
        write_identification_report(
            made[0] / "fit", held_out, made[0] / "report", QUIET
        )


def test_the_fitting_log_is_no_held_out_log(made, tmp_path):
    folder = made[0]
    log = Recording.load(folder / "log")
    with pytest.raises(ConfigError, match="sequence 0 of the held-out log plays the"):
        write_identification_report(folder / "fit", log, tmp_path / "r", QUIET)
    assert not (tmp_path / "r").exists()


def test_a_held_out_log_of_another_controller_is_refused(made, held_out, tmp_path):
    commands = held_out.metadata["commands"] | {"f_scale": 1.0}
    other = replace(held_out, metadata=held_out.metadata | {"commands": commands})
    with pytest.raises(LogError, match="the two recordings differ in commands"):
        write_identification_report(made[0] / "fit", other, tmp_path / "r", QUIET)


@pytest.fixture
def copied(made, tmp_path):
    """A copy of the fit's folder, and its summary."""
    shutil.copytree(made[0] / "fit", tmp_path / "fit")
    return tmp_path / "fit", json.loads((tmp_path / "fit" / "fit.json").read_text())


def rewrite(copied, **changes):
    folder, summary = copied
    (folder / "fit.json").write_text(json.dumps(summary | changes))
    return folder


def test_a_fit_that_is_not_finished_is_refused(copied):
    with pytest.raises(LogError, match="is not finished; go on with it by"):
        Fitted.load(rewrite(copied, state="running"))


def test_a_fit_whose_log_is_gone_is_refused(copied):
    with pytest.raises(LogError, match="is of the log nowhere, which is not there"):
        Fitted.load(rewrite(copied, log="nowhere"))


def test_a_fit_whose_log_has_changed_is_refused(copied, made):
    other = str(made[0] / "other")
    with pytest.raises(LogError, match="has changed since it was fitted"):
        Fitted.load(rewrite(copied, log=other))


def test_a_damaged_summary_is_refused(copied):
    with pytest.raises(LogError, match="is damaged: KeyError 'low'; fit the log again"):
        Fitted.load(rewrite(copied, parameters=[{"name": "damping", "unit": "1"}]))


def test_a_fit_without_its_generations_is_refused(copied):
    (copied[0] / "generations.jsonl").unlink()
    with pytest.raises(LogError, match=r"is not whole: generations\.jsonl cannot be"):
        Fitted.load(copied[0])


def test_the_history_counts_simulated_logs(made):
    fitted = Fitted.load(made[0] / "fit")
    counts, errors = zip(*fitted.search.history, strict=True)
    assert counts[-1] == fitted.search.evaluations
    assert list(counts) == sorted(counts)
    assert list(errors) == sorted(errors, reverse=True)


def judged(held_out, fitting=0.05, delay=0.0, *, standard=True, fits_delay=True):
    return judge_transfer(
        held_out, fitting, delay, standard=standard, fits_delay=fits_delay
    )


def test_go_at_the_limit_and_no_go_above():
    at, above = judged(TRANSFER_LIMIT), judged(1.01 * TRANSFER_LIMIT)
    assert (at.answer, above.answer) == ("go", "no go")
    for verdict in (at, above):
        assert f"{1e3 * TRANSFER_LIMIT:g} mm" in verdict.sentence
        assert "docs/identification.md" in verdict.sentence
        assert "so the clearance may be far smaller" in verdict.sentence


@pytest.mark.parametrize(
    ("error", "answers"),
    [
        (0.001, ("go", "go")),  # identified
        (UNTARED_LIMIT, ("go", "go")),
        (0.045, ("go", "no go")),
        (0.0617, ("no go", "no go")),  # medium, not identified
    ],
)
def test_the_line_answers_with_a_tare_and_without(error, answers):
    verdict = judged(error)
    assert (verdict.answer, verdict.untared) == answers
    assert verdict.line == f"with a tare: {answers[0]}; without: {answers[1]}"


def test_the_model_that_was_not_identified_is_judged_beside():
    verdict = judge_transfer(
        1e-3, 1e-3, 0.0, before=0.045, standard=True, fits_delay=True
    )
    assert (verdict.answer, verdict.untared) == ("go", "go")
    assert "has 45.0 mm: with a tare go, without no go" in verdict.sentence


def test_a_delay_is_no_go_however_small_the_error():
    at, beyond = judged(1e-3, delay=DELAY_LIMIT), judged(1e-3, delay=0.0125)
    assert (at.answer, beyond.answer) == ("go", "no go")
    assert "a delay of 12.5 ms that the model lacks is beyond 10 ms" in beyond.sentence
    assert "fit command_delay too (--parameters extended)" in beyond.sentence


def test_a_delay_that_was_not_fitted_is_pointed_out():
    assert "The delay was not fitted" in judged(1e-3, fits_delay=False).sentence
    assert "The delay was not fitted" not in judged(1e-3).sentence


def test_another_excitation_makes_the_limit_a_rough_guide():
    assert "only a rough guide" in judged(0.001, standard=False).sentence
    assert "only a rough guide" not in judged(0.001).sentence


def test_a_fit_that_follows_its_log_more_than_the_arm_is_called_so():
    sentence = judged(0.003, fitting=0.001).sentence
    assert "The fitting log is met 3.0 times better than the held-out one" in sentence


@pytest.mark.parametrize("of_model", [0.0, 0.005])
def test_a_delay_that_the_model_lacks_is_found(tmp_path, of_model):
    twin = replace(load_twin("easy"), command_delay=0.02)
    (tmp_path / "late.toml").write_text(twin.to_toml())
    arm = f"twin:{tmp_path / 'late.toml'}"
    config = RecordConfig(arm=arm, out=tmp_path / "log", sequences=2, steps=12)
    replay = LogReplay(record(config, QUIET))
    model = replace(nominal_model(), command_delay=of_model)
    assert hidden_delay(replay, model) == pytest.approx(0.02 - of_model, abs=0.003)


def test_a_parameter_without_an_interval_can_be_drawn():
    dead = ParameterEstimate(
        name="armature_7",
        unit="kg m2",
        value=0.1,
        uncertainty=Uncertainty(standard_error=np.inf, interval=(-np.inf, np.inf)),
        sensitivity=0.0,
        confounding=Confounding(variance_inflation=np.inf, partner="", correlation=0.0),
        step_left=0.0,
        judgement=Judgement(verdict="no effect", sentence=""),
    )
    result = Identifiability(
        estimates=(dead,),
        condition_number=np.inf,
        sequences=3,
        quantile=4.3,
        residual_rms=0.0,
    )
    assert draw_intervals(result, [(0.0, 1.0)]).startswith(PNG)
    assert draw_convergence([(8, 0.01)], 0.02).startswith(PNG)
