"""The report of an identification: HTML, PNG and JSON."""

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import track
from rich.table import Table

from dovetail.control.period import DEFAULT_PERIOD
from dovetail.distribution import installed_version
from dovetail.errors import ConfigError
from dovetail.files import claim_output_folder, write_atomic
from dovetail.identify.contact_estimate import ContactEstimate
from dovetail.identify.curves import curves
from dovetail.identify.figures import (
    draw_after,
    draw_convergence,
    draw_intervals,
    draw_trajectories,
)
from dovetail.identify.fitted import Fitted
from dovetail.identify.hidden_delay import hidden_delay
from dovetail.identify.recorder import MotionsConfig
from dovetail.identify.recording import Recording
from dovetail.identify.replay import LogReplay
from dovetail.identify.transfer_limit import Verdict, judge_transfer
from dovetail.identify.uncertainty import (
    KNOWN_SHARE,
    Identifiability,
    ParameterEstimate,
    analyse,
)
from dovetail.page import facts, figure, finite, page, table, text
from dovetail.types import Array
from dovetail.zoomable import NOTE

_STEPS = {"1": (0.01, "1 %"), "s": (1e-3, "ms")}
"""Step of a parameter that the sensitivity is given for, by unit; else one unit."""


@dataclass(frozen=True)
class Comparison:
    """Simulation and arm on one log, before and after identification."""

    log: str
    """Name of the log, such as "fitting log"."""
    measured: Sequence[Array]
    """TCP of the arm [m], shape (cycles, 3) per sequence."""
    before: Sequence[Array]
    """The same of the controller's own model."""
    after: Sequence[Array]
    """The same of the fitted model."""

    def errors(self, which: str) -> tuple[float, float]:
        """Return RMS and largest distance [m] of the model `before` or `after`."""
        simulated = np.concatenate(vars(self)[which])
        distance = np.linalg.norm(simulated - np.concatenate(self.measured), axis=1)
        return float(np.sqrt(np.mean(distance**2))), float(distance.max())

    def numbers(self) -> dict[str, float]:
        """Return the four errors by name [m]."""
        (rms_before, max_before), (rms_after, max_after) = (
            self.errors("before"),
            self.errors("after"),
        )
        return {
            "rms_before": rms_before,
            "max_before": max_before,
            "rms_after": rms_after,
            "max_after": max_after,
        }


@dataclass(frozen=True)
class IdentificationReport:
    """Written report and its results."""

    identifiability: Identifiability
    comparisons: tuple[Comparison, ...]
    """On the fitting log and, where there is one, on the held-out log."""
    verdict: Verdict
    files: tuple[Path, ...]


def write_identification_report(
    fit_folder: Path, held_out: Recording | None, out: Path, console: Console
) -> IdentificationReport:
    """Compare a fitted model with the arm and say what is known of each parameter.

    Args:
        fit_folder: What `dovetail identify fit` wrote.
        held_out: A recording of the same arm that was not fitted.
        out: Folder for report.html, report.json and the figures; new or empty.
        console: Where the table is printed.

    Raises:
        ConfigError: The held-out log plays what was fitted, or the output folder is
            not empty.
        LogError: The fit is missing, damaged or not finished, its recording is missing
            or has changed, or the held-out log is of another robot, task or controller.
    """
    fit = Fitted.load(fit_folder)
    if held_out is not None:
        _require_comparable(fit.recording, held_out)
    folder = claim_output_folder(out)
    replay = LogReplay(fit.recording, fit.plant)
    comparisons = [_compare("fitting log", replay, fit)]
    bar = partial(track, description="sensitivities", console=console)
    result = analyse(replay, fit.parameters, fit.vector, bar)
    model = fit.parameters.to_model(fit.vector, fit.plant)
    delay_left = hidden_delay(replay, model)
    replay.close()
    if held_out is not None:
        other = LogReplay(held_out, fit.plant)
        comparisons.append(_compare("held-out log", other, fit))
        other.close()
    errors = [c.errors("after")[0] for c in comparisons]
    verdict = judge_transfer(
        errors[1] if held_out else None,
        errors[0],
        delay_left,
        before=comparisons[1].errors("before")[0] if held_out else None,
        standard=_is_standard(held_out or fit.recording),
        fits_delay="command_delay" in fit.parameters.names,
    )
    figures = _draw(fit, comparisons, result)
    files = [write_atomic(folder / name, png) for name, (_, png) in figures.items()]
    content = _content(fit, held_out, comparisons, result, verdict)
    drawn = _curves(comparisons, fit.recording.period)
    files += [
        write_atomic(folder / "report.html", _to_html(content, result, figures, drawn)),
        write_atomic(
            folder / "report.json",
            json.dumps(finite(content), indent=2, allow_nan=False) + "\n",
        ),
    ]
    _print(comparisons, result, fit.contact, verdict, console)
    return IdentificationReport(result, tuple(comparisons), verdict, tuple(files))


def _require_comparable(fitted: Recording, held_out: Recording) -> None:
    """Refuse a held-out log that proves nothing about the fit."""
    fitted.require_like(held_out)
    for number, ours in enumerate(fitted.sequences):
        for other, theirs in enumerate(held_out.sequences):
            if np.array_equal(ours.f_star, theirs.f_star):
                raise ConfigError(
                    f"sequence {other} of the held-out log plays the same f* as "
                    f"sequence {number} of the fitting log; record it with another "
                    "--seed"
                )


def _is_standard(recording: Recording) -> bool:
    """Say whether a log has the excitation that the limit was measured with."""
    usual, metadata = MotionsConfig(), recording.metadata
    return (
        metadata["commands"]["f_scale"] == usual.f_scale
        and metadata["controller"]["force_damping"] == usual.force_damping
        and metadata["excitation"]["steps"] == usual.steps
        and recording.period == DEFAULT_PERIOD
    )


def _compare(log: str, replay: LogReplay, fit: Fitted) -> Comparison:
    return Comparison(
        log,
        replay.recording.positions(),
        replay.run(fit.parameters.nominal(fit.plant)),
        replay.run(fit.parameters.to_model(fit.vector, fit.plant)),
    )


def _draw(
    fit: Fitted, comparisons: Sequence[Comparison], result: Identifiability
) -> dict[str, tuple[str, bytes]]:
    """Return caption and PNG of each figure by file name."""
    period, arm = fit.recording.period, fit.recording.metadata["arm"]
    figures = {}
    for comparison, (first, second) in zip(
        comparisons,
        (("before", "after"), ("held-out-before", "held-out-after")),
        strict=False,
    ):
        for name, which, draw in (
            (first, "before", draw_trajectories),
            (second, "after", draw_after),
        ):
            rms = 1e3 * comparison.errors(which)[0]
            caption = f"{which.capitalize()} identification, {comparison.log}"
            png = draw(
                comparison.measured,
                vars(comparison)[which],
                period=period,
                title=f"{caption}: {arm}, {rms:.2f} mm RMS",
            )
            figures[f"{name}.png"] = (caption, png)
    bounds = [(p.low, p.high) for p in fit.parameters.parameters]
    png = draw_intervals(result, bounds)
    figures["intervals.png"] = ("Values and 95 % intervals in the search's bounds", png)
    png = draw_convergence(fit.search.history, comparisons[0].errors("before")[0])
    figures["convergence.png"] = ("Convergence of the search", png)
    return figures


def _curves(comparisons: Sequence[Comparison], period: float) -> list[str]:
    """Return the part of the page in which one can zoom."""
    parts = []
    for comparison in comparisons:
        names = ("measured", "before", "after")
        runs = {name: vars(comparison)[name] for name in names}
        parts.append(f"<h2>Look closer: {text(comparison.log)}</h2>")
        parts.append(curves(runs, period=period, with_library=not parts[1:]))
    return [
        *parts,
        f'<p class="note">{NOTE}</p>',
    ]


def _content(
    fit: Fitted,
    held_out: Recording | None,
    comparisons: Sequence[Comparison],
    result: Identifiability,
    verdict: Verdict,
) -> dict[str, Any]:
    """Return everything that the report says as plain data."""
    return {
        "title": f"Identification of {fit.recording.metadata['arm']}",
        "verdict": asdict(verdict) | {"line": verdict.line},
        "errors": {c.log: c.numbers() for c in comparisons},
        "parameters": [e.numbers() for e in result.estimates],
        "contact": [estimate.numbers() for estimate in fit.contact],
        "condition_number": result.condition_number,
        "sequences": result.sequences,
        "residual_rms": result.residual_rms,
        "fit": {
            "plant": fit.plant,
            "evaluations": fit.search.evaluations,
            "wall_time": fit.search.wall_time,
            "history": fit.search.history,
            "warnings": list(fit.warnings),
            "settings": {
                "seed": fit.summary["settings"]["seed"],
                "log": fit.summary["log"],
                "made": fit.summary["made"],
                "versions": fit.summary["versions"],
            },
        },
        "fitting_log": _about(fit.recording),
        "held_out_log": None if held_out is None else _about(held_out),
        "provenance": {
            "written": datetime.now(UTC).isoformat(timespec="seconds"),
            "dovetail": installed_version("dovetail"),
            "mujoco": installed_version("mujoco"),
            "python": platform.python_version(),
        },
    }


def _about(recording: Recording) -> dict[str, Any]:
    names = ("arm", "robot", "task", "period", "excitation", "commands")
    return {name: recording.metadata[name] for name in names}


def _to_html(
    content: Mapping[str, Any],
    result: Identifiability,
    figures: Mapping[str, tuple[str, bytes]],
    drawn: Sequence[str],
) -> str:
    answer, sentence = content["verdict"]["line"], content["verdict"]["sentence"]
    logs = [
        [log, *(f"{1e3 * n[key]:.2f}" for key in _ERRORS.values())]
        for log, n in content["errors"].items()
    ]
    fit = content["fit"]
    judged = [estimate.judgement.sentence for estimate in result.estimates]
    judged += [ContactEstimate(**one).sentence() for one in content["contact"]]
    sentences = "\n".join(f"<li>{text(sentence)}.</li>" for sentence in judged)
    parts = [
        f"<h1>{text(content['title'])}</h1>",
        f'<p class="lead"><span class="rate">{text(answer)}</span>'
        f"{text(sentence)}.</p>",
        table(["distance from the arm", *_ERRORS], logs),
        f'<p class="note">Simulated in {text(fit["plant"])}; {fit["evaluations"]} '
        f"simulated logs in {fit['wall_time']:.1f} s.</p>",
        "<h2>Parameters</h2>",
        *(f'<p class="note">Warning: {text(w)}.</p>' for w in fit["warnings"]),
        table(_HEADS, [_cells(e) for e in result.estimates]),
        f'<p class="note">Condition number {_short(result.condition_number)} (Jacobian '
        f"with columns of unit length). Intervals: jackknife over {result.sequences} "
        "sequences, Student's t, wider by the priors and by what was not fitted: the "
        "other parameters, centres of mass and inertias of the links. Inflation: how "
        "much wider the variance is because "
        f"the other parameters are not known either. {_RULE}.</p>",
        f"<ul>\n{sentences}\n</ul>",
        *(figure(caption, png) for caption, png in figures.values()),
        *drawn,
        *facts("Fit", fit["settings"]),
        *facts("Fitting log", content["fitting_log"]),
        *facts("Held-out log", content["held_out_log"] or {}),
        *facts("Where this was made", content["provenance"]),
    ]
    return page(content["title"], parts)


_ERRORS = {
    "before, RMS [mm]": "rms_before",
    "before, largest [mm]": "max_before",
    "after, RMS [mm]": "rms_after",
    "after, largest [mm]": "max_after",
}
_RULE = (
    f"Known: the 95 % interval is at most +-{100 * KNOWN_SHARE:g} % of the parameter's "
    "usual range"
)
_HEADS = (
    *("parameter", "value", "95 % interval", "unit", "tool moves [mm RMS]"),
    *("inflation", "most like", "correlation", "verdict"),
)


def _cells(estimate: ParameterEstimate) -> list[str]:
    step, name = _STEPS.get(estimate.unit, (1.0, estimate.unit))
    low, high = estimate.uncertainty.interval
    others = estimate.confounding
    return [
        estimate.name,
        f"{estimate.value:.4g}",
        f"{_short(low)} to {_short(high)}",
        estimate.unit,
        f"{1e3 * step * estimate.sensitivity:.3g} per {name}",
        _short(others.variance_inflation),
        others.partner or "-",
        f"{others.correlation:.3f}" if others.partner else "-",
        estimate.judgement.verdict,
    ]


def _short(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "unbounded"


def _print(
    comparisons: Sequence[Comparison],
    result: Identifiability,
    contact: Sequence[ContactEstimate],
    verdict: Verdict,
    console: Console,
) -> None:
    """Print errors, parameters and the go / no-go line."""
    errors = Table("distance [mm]", box=SIMPLE_HEAD)
    for name in ("before, RMS", "largest", "after, RMS", "largest"):
        errors.add_column(name, justify="right")
    for comparison in comparisons:
        numbers = comparison.numbers()
        errors.add_row(
            comparison.log, *(f"{1e3 * numbers[key]:.2f}" for key in _ERRORS.values())
        )
    console.print(errors)
    parameters = Table(box=SIMPLE_HEAD)
    for name in ("parameter", "value", "95 % interval", "unit", "verdict"):
        is_text = name in ("parameter", "unit", "verdict")
        parameters.add_column(name, justify="left" if is_text else "right")
    for estimate in result.estimates:
        name, value, interval, unit, *_, verdict_word = _cells(estimate)
        parameters.add_row(name, value, interval, unit, verdict_word)
    console.print(parameters)
    console.print(f"condition number {_short(result.condition_number)}; {_RULE}")
    for estimate in result.estimates:
        if estimate.judgement.verdict != "known":
            console.print(f"- {estimate.judgement.sentence}", soft_wrap=True)
    for one in contact:
        console.print(f"- {one.sentence()}", soft_wrap=True)
    console.print(f"{verdict.line}: {verdict.sentence}", soft_wrap=True)
