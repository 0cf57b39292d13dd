"""A finished fit as its folder has it, with the recording that was fitted."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from dovetail.errors import LogError
from dovetail.identify.contact_estimate import ContactEstimate
from dovetail.identify.fit_folder import GENERATIONS, SUMMARY, read_summary
from dovetail.identify.parameters import Parameter, ParameterSet
from dovetail.identify.recording import Recording
from dovetail.reading import parse_json, read_text
from dovetail.types import Array


@dataclass(frozen=True, kw_only=True)
class FittedSearch:
    """Course of the search for the parameters."""

    history: tuple[tuple[int, float], ...]
    """Simulated logs done and best error so far [m], after each generation."""
    evaluations: int
    """Logs simulated."""
    wall_time: float
    """Time of the search [s]."""


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """Result of a fit, with its log and its search."""

    recording: Recording
    """The fitting log."""
    plant: str
    """Physics engine of the simulation."""
    parameters: ParameterSet
    vector: Array
    """Fitted value of each parameter, in its unit."""
    search: FittedSearch
    """Search that found them."""
    warnings: tuple[str, ...]
    """Warnings of the fit."""
    contact: tuple[ContactEstimate, ...]
    """Contact parameters from the recording's slides; empty where it has none."""
    summary: dict[str, Any]
    """Everything that `fit.json` holds."""

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Read the folder of a fit, and the recording that it names.

        Raises:
            LogError: No fit, one that is not finished, or a recording that is not
                there or has changed since.
        """
        summary = read_summary(folder)
        if summary.get("state") != "done":
            raise LogError(
                f"the fit in {folder} is not finished; go on with it by `dovetail "
                "identify fit LOG --resume`"
            )
        try:
            return cls._from(folder, summary)
        except (KeyError, TypeError, ValueError) as error:
            raise LogError(
                f"{folder / SUMMARY} is damaged: {type(error).__name__} {error}; fit "
                "the log again"
            ) from error

    @classmethod
    def _from(cls, folder: Path, summary: dict[str, Any]) -> Self:
        recording = _load_recording(folder, summary)
        rows, result = summary["parameters"], summary["result"]
        names = ("name", "unit", "low", "high", "start", "spread")
        best = np.asarray(summary["history_mm"], dtype=float) / 1e3
        sizes = _generation_sizes(folder)
        done = int(result["evaluations"]) - sum(sizes) + np.cumsum(sizes)
        return cls(
            recording=recording,
            plant=summary["settings"]["plant"],
            parameters=ParameterSet(
                tuple(Parameter(*(row[n] for n in names)) for row in rows),
                recording.cell.robot.motors,
            ),
            vector=np.array([row["value"] for row in rows], dtype=float),
            search=FittedSearch(
                history=tuple(
                    (int(n), float(e)) for n, e in zip(done, best, strict=True)
                ),
                evaluations=int(result["evaluations"]),
                wall_time=float(result["wall_time"]),
            ),
            warnings=tuple(result["warnings"]),
            contact=tuple(ContactEstimate(**one) for one in result.get("contact", [])),
            summary=summary,
        )


def _generation_sizes(folder: Path) -> list[int]:
    """Return how many logs each generation of the search simulated."""
    try:
        lines = read_text(folder / GENERATIONS).splitlines()
    except OSError as error:
        raise LogError(
            f"{folder} is not whole: {GENERATIONS} cannot be read ({error.strerror}); "
            "fit the log again"
        ) from error
    return [len(parse_json(line, GENERATIONS)["values"]) for line in lines]


def _load_recording(folder: Path, summary: dict[str, Any]) -> Recording:
    """Read the fitting log and make sure that it is still the one that was fitted."""
    path = Path(summary["log"])
    if not path.is_dir():
        raise LogError(
            f"the fit in {folder} is of the log {path}, which is not there; put it "
            "back, or run this where its path leads to it"
        )
    recording = Recording.load(path)
    now, then = recording.fingerprint(), summary["settings"]["log"]
    if now != then:
        raise LogError(
            f"the log {path} has changed since it was fitted (hash {now}, then "
            f"{then}); fit it again"
        )
    return recording
