"""A policy for each pair in a folder: is it learned, does it transfer, how hard is it?

The folder has part files, or a folder with a `part.toml` for each pair, as
benchmarks/mesh_pairs.py makes them. For each pair a policy is trained and tried in its
own simulation, on twin `medium` with the true pose of the fixture, and there with the
pose 2 mm and 20 mrad wrong. A pair's numbers are in OUT/ID/row.json once all is done; a
pair that has them is left out, and a training that was cut short goes on, so the
command can be given again after a kill. OUT/index.html has a picture of each pair and
the table, after each pair.

    python benchmarks/specialists.py runs/automate --out runs/specialists
    python benchmarks/specialists.py PAIRS --out OUT --only 00015,01136 --tries 2 \
        --recipe insert_any --num-envs 8 --steps 16000

Options that it does not have itself go to `dovetail train`.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from rich.console import Console
from scipy.spatial import ConvexHull

from dovetail.envs.registered import make_task
from dovetail.errors import DovetailError
from dovetail.evaluation.config import EvaluationConfig
from dovetail.evaluation.evaluate import evaluate
from dovetail.files import write_atomic
from dovetail.page import figure, page, table
from dovetail.poses import TOOL_DOWN
from dovetail.tasks.insert.task import Insert
from dovetail.types import Array
from dovetail.workcell.end_outline import surface_points
from dovetail.workcell.parts import Part

ENV = "dovetail/Insert-v0"
WRONG = "late?bias=0.002&turn=0.02"
HEADS = (
    *("pair", "pieces", "steps", "training", "own", "medium, true pose"),
    *("medium, pose 2 mm wrong", "time, pose wrong", "peak p95"),
)


@dataclass(frozen=True)
class Given:
    """What is asked for."""

    out: Path
    """Folder of all results."""
    tries: int
    """Tries at each of three poses, in each of the two tables on the twin."""
    train: tuple[str, ...]
    """Words of each training."""


def main() -> None:
    """Train and try each pair that has no row yet, and write the page after each."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", help="names of the pairs, A,B; left out, all")
    parser.add_argument("--tries", type=int, default=10, help="at each of 3 poses")
    words, further = parser.parse_known_args()
    given = Given(words.out, words.tries, tuple(further))
    given.out.mkdir(parents=True, exist_ok=True)
    pairs = {
        _name(Path(file)): file for file in Insert.listed("part", str(words.folder))
    }
    chosen = words.only.split(",") if words.only else sorted(pairs)
    if unknown := set(chosen) - set(pairs):
        raise SystemExit(f"no pairs {sorted(unknown)}; known: {sorted(pairs)}")
    rows: dict[str, dict[str, Any]] = {}
    for name in chosen:
        rows[name] = _row(name, pairs[name], given)
        print(" | ".join(_cells(name, rows[name])), flush=True)
        write_atomic(given.out / "index.html", _page(rows, pairs))
    done = [row for row in rows.values() if "wrong" in row]
    won = sum(row["wrong"]["successes"] for row in done)
    tries = sum(row["wrong"]["tries"] for row in done)
    print(
        f"{len(done)} of {len(rows)} pairs trained; with a pose 2 mm wrong "
        f"{won}/{tries}"
    )


def _name(file: Path) -> str:
    return file.parent.name if file.name == "part.toml" else file.stem


def _row(name: str, part: str, given: Given) -> dict[str, Any]:
    """Return a pair's numbers; they are made if they are not there."""
    folder = given.out / name
    file = folder / "row.json"
    asked = {"tries": given.tries, "train": list(given.train)}
    if file.exists():
        row = json.loads(file.read_text())
        if row["asked"] != asked:
            raise SystemExit(
                f"{file} is of {row['asked']}, and now {asked} is given: choose "
                "another --out"
            )
        return row
    folder.mkdir(exist_ok=True)
    task = make_task(ENV, {"part": part})
    pieces = [len(one.primitives) for one in (task.held(), task.fixture(0.0))]
    row: dict[str, Any] = {"pieces": pieces, "asked": asked}
    try:
        row |= _train(folder / "run", part, given.train)
        row["medium"] = _try(folder / "run", None, given.tries)
        row["wrong"] = _try(folder / "run", WRONG, given.tries)
    except DovetailError as error:
        return row | {"error": str(error)}  # not kept: it is tried again
    write_atomic(file, json.dumps(row))
    return row


def _train(run: Path, part: str, words: tuple[str, ...]) -> dict[str, Any]:
    """Train, or go on with a training that was cut short; return what it took."""
    new = ["--part", part, *words]
    if not (run / "evaluation.json").exists():
        words = () if (run / "config.toml").exists() else tuple(new)
        resume = [] if words else ["--resume"]
        command = [sys.executable, "-m", "dovetail", "train", *resume, *words]
        done = subprocess.run(
            [*command, "--out", str(run)], check=False, capture_output=True, text=True
        )
        if done.returncode:
            raise DovetailError(f"training ended: {done.stderr.strip()[-400:]}")
    episodes = (run / "progress.csv").read_text().splitlines()[1:]
    own = json.loads((run / "evaluation.json").read_text())
    policy = json.loads((run / "policy.json").read_text())
    return {
        "steps": int(episodes[-1].split(",")[0]) if episodes else 0,
        "seconds": policy["provenance"]["wall_time_s"],
        "own": [own["successes"], own["episodes"]],
    }


def _try(run: Path, tracker: str | None, tries: int) -> dict[str, Any]:
    """Return the sum row of a table on the twin."""
    told: dict[str, Any] = {} if tracker is None else {"tracker": tracker}
    with tempfile.TemporaryDirectory() as folder:
        config = EvaluationConfig(
            policy=str(run),
            twin="medium",
            tries=tries,
            keep_logs=False,
            out=Path(folder),
            **told,
        )
        return evaluate(config, Console(quiet=True)).rows[-1].numbers()


def _cells(name: str, row: dict[str, Any]) -> list[str]:
    """Return a line of the table; a pair that could not be trained says why."""
    pieces = " + ".join(map(str, row["pieces"]))
    if "wrong" not in row:
        return [name, pieces, row["error"][:200], *["-"] * (len(HEADS) - 3)]
    medium, wrong = row["medium"], row["wrong"]
    median = wrong["steps_median"]
    return [
        name,
        pieces,
        f"{row['steps']}",
        f"{row['seconds']:.0f} s",
        f"{row['own'][0]}/{row['own'][1]}",
        f"{medium['successes']}/{medium['tries']}",
        f"{wrong['successes']}/{wrong['tries']}",
        "-" if np.isnan(median) else f"{0.05 * median:.1f} s",
        f"{wrong['force_peak_p95']:.0f} N",
    ]


def _page(rows: dict[str, dict[str, Any]], pairs: dict[str, str]) -> str:
    """Return the table, and a picture of each pair."""
    lines = [_cells(name, row) for name, row in rows.items()]
    drawn = [figure(name, _draw(pairs[name])) for name in rows]
    parts = ["<h1>A policy for each pair</h1>", table(HEADS, lines), *drawn]
    return page("A policy for each pair", parts)


@cache  # the page is written anew after each pair
def _draw(part: str) -> bytes:
    """Draw the held part over its fixture, small."""
    task: Any = make_task(ENV, {"part": part})
    depth = task.depths()[0]
    over = np.array([0.0, 0.0, 1.5 * depth])
    held = tuple(one.moved(over, TOOL_DOWN) for one in task.held().primitives)
    canvas = Figure(figsize=(2.2, 2.2), dpi=80)
    axes: Any = canvas.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    for pieces, colour in (
        (task.fixture(0.0).primitives, "#d8d2c4"),
        (held, "#e58c26"),
    ):
        for piece in pieces:
            corners = 1e3 * surface_points(Part("piece", (piece,)))
            axes.add_collection3d(Poly3DCollection(_faces(corners), facecolors=colour))
    points = 1e3 * np.vstack(
        [surface_points(Part("all", held)), task.fixture(0.0).corners]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low)
    axes.set_axis_off()
    file = BytesIO()
    canvas.savefig(file, format="png")
    return file.getvalue()


def _faces(corners: Array) -> Array:
    """Return the triangles around some points."""
    return corners[ConvexHull(corners, qhull_options="QJ").simplices]


if __name__ == "__main__":
    main()
