"""Episode logs as a folder of LeRobotDataset, format 3.0: Parquet and JSON.

A frame is a policy step of 50 ms: what was seen before it, unscaled in SI units, the
action, and what came of it. There are no pictures.

Reference:
    The package `lerobot-dataset`, whose files these are.
"""

import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.control.period import POLICY_PERIOD
from dovetail.errors import LogError, MissingDependencyError, install_command
from dovetail.files import require_empty
from dovetail.learn.recorded_steps import MEANT, RecordedSteps, find_logs, read_steps

VERSION = "v3.0"
FPS = round(1.0 / POLICY_PERIOD)
_FILE = Path("chunk-000") / "file-000.parquet"
_QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
_INDEX = "__index_level_0__"  # pandas' name of an index without one


def write_lerobot(paths: Sequence[str | Path], folder: Path) -> int:
    """Write Episode logs as one data set.

    Args:
        paths: Episode logs, or folders of them.
        folder: Of the data set, new or empty; it is whole or absent.

    Returns:
        Number of frames.

    Raises:
        LogError: A log cannot be read, or is of another robot, task, action or
            observation than the first one; or the disk is full.
        ConfigError: The folder holds something.
        MissingDependencyError: No pyarrow.
    """
    require_room(folder)
    files = find_logs(paths)
    episodes = [read_steps(path) for path in files]
    for path, steps in zip(files, episodes, strict=True):
        _require_alike(path, steps, files[0], episodes[0])
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        _write(episodes, beside)
        beside.chmod(0o755)
        if folder.exists():
            folder.rmdir()
        beside.rename(folder)
    except OSError as error:
        raise LogError(
            f"cannot write the data set {folder}: {error.strerror or error}; nothing "
            "half-written is left"
        ) from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    return sum(map(len, episodes))


def require_room(folder: Path, option: str = "--out") -> None:
    """Refuse now what `write_lerobot` would refuse when all is recorded.

    Args:
        folder: Of the data set.
        option: That names it, for the message.

    Raises:
        ConfigError: The folder holds something.
        MissingDependencyError: No pyarrow.
    """
    require_empty(folder, option)
    _pyarrow()


def _require_alike(
    path: Path, steps: RecordedSteps, first: Path, wanted: RecordedSteps
) -> None:
    pairs = {
        "task": (_task_name(steps), _task_name(wanted)),
        **{n: (steps.cell.get(n), wanted.cell.get(n)) for n in ("robot", "cell")},
        **{name: (steps.action.get(name), wanted.action.get(name)) for name in MEANT},
        "columns": (steps.columns, wanted.columns),
    }
    for name, (theirs, ours) in pairs.items():
        if theirs != ours:
            raise LogError(
                f"the log {path} has the {name} {str(theirs)[:80]}, {first} has "
                f"{str(ours)[:80]}: one data set is of one; write them apart"
            )


def _write(episodes: list[RecordedSteps], folder: Path) -> None:
    first = episodes[0]
    task = _task_name(first)
    axes = [str(axis) for axis in first.action.get("axes", [])]
    features: dict[str, Any] = {
        "observation.state": _feature("float32", list(first.columns)),
        "action": _feature("float32", axes),
        "next.reward": _feature("float32"),
        "next.done": _feature("bool"),
        "next.success": _feature("bool"),
        "is_intervention": _feature("bool"),
        "timestamp": _feature("float32"),
        **{name: _feature("int64") for name in ("frame_index", "episode_index")},
        **{name: _feature("int64") for name in ("index", "task_index")},
    }
    begins = np.cumsum([0, *map(len, episodes)]).tolist()
    frames = [
        _frames(steps, number, begins[number]) for number, steps in enumerate(episodes)
    ]
    whole = {name: np.concatenate([part[name] for part in frames]) for name in features}
    rows = [
        {
            "episode_index": number,
            "tasks": [task],
            "length": len(steps),
            "data/chunk_index": 0,
            "data/file_index": 0,
            "dataset_from_index": begins[number],
            "dataset_to_index": begins[number + 1],
            **_flat(_statistics(frames[number])),
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        for number, steps in enumerate(episodes)
    ]
    info = {
        "codebase_version": VERSION,
        "robot_type": str(first.cell.get("robot", "")),
        "total_episodes": len(episodes),
        "total_frames": begins[-1],
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": FPS,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }
    _write_tables(folder, whole, rows, task)
    for name, content in (("info", info), ("stats", _statistics(whole))):
        (folder / "meta" / f"{name}.json").write_text(json.dumps(content, indent=4))


def _task_name(steps: RecordedSteps) -> str:
    own = steps.cell.get("task")
    own = own if isinstance(own, Mapping) else {}
    plain = ("axes", own.get("axes")), ("facing", "up")  # that go without saying
    words = [v for k, v in own.items() if isinstance(v, str) and (k, v) not in plain]
    return ", ".join([str(steps.cell.get("env_id", "")), *words])


def _feature(kind: str, names: list[str] | None = None) -> dict[str, Any]:
    return {"dtype": kind, "shape": [len(names) if names else 1], "names": names}


def _frames(steps: RecordedSteps, number: int, begin: int) -> dict[str, Any]:
    """Return the columns of one episode."""
    count = len(steps)
    frame = np.arange(count)
    is_last = frame == count - 1
    return {
        "observation.state": steps.seen[:-1].astype(np.float32),
        "action": steps.actions,
        "next.reward": steps.rewards,
        "next.done": is_last,
        "next.success": is_last & steps.success,
        "is_intervention": steps.is_led,
        "timestamp": (frame / FPS).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full(count, number),
        "index": begin + frame,
        "task_index": np.zeros(count, dtype=np.int64),
    }


def _statistics(frames: dict[str, Any]) -> dict[str, dict[str, list[Any]]]:
    """Return the statistics of each column, each a list over its numbers."""
    found = {}
    for name, values in frames.items():
        rows = values.reshape(len(values), -1).astype(float)
        found[name] = {
            "min": rows.min(axis=0).tolist(),
            "max": rows.max(axis=0).tolist(),
            "mean": rows.mean(axis=0).tolist(),
            "std": rows.std(axis=0).tolist(),
            "count": [len(rows)],
            **{q: np.quantile(rows, p, axis=0).tolist() for q, p in _QUANTILES.items()},
        }
    return found


def _flat(statistics: dict[str, dict[str, Any]]) -> dict[str, Any]:
    return {
        f"stats/{name}/{kind}": value
        for name, kinds in statistics.items()
        for kind, value in kinds.items()
    }


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet as parquet
    except ImportError as error:
        raise MissingDependencyError(
            f"a LeRobotDataset needs pyarrow: {install_command('log')}"
        ) from error
    return pyarrow, parquet


def _write_tables(
    folder: Path, whole: dict[str, Any], rows: list[dict[str, Any]], task: str
) -> None:
    pyarrow, parquet = _pyarrow()

    def column(values: Any) -> Any:
        if values.ndim == 1:
            return pyarrow.array(values)
        flat = pyarrow.array(np.ascontiguousarray(values).ravel())
        return pyarrow.FixedSizeListArray.from_arrays(flat, values.shape[1])

    data = pyarrow.table({name: column(values) for name, values in whole.items()})
    tasks = pyarrow.table({"task_index": pyarrow.array([0]), _INDEX: [task]})
    kinds = (("task_index", "int64", "int64"), (None, "unicode", "object"))
    about = {
        "index_columns": [_INDEX],
        "column_indexes": [],
        "columns": [
            {
                "name": name,
                "field_name": name or _INDEX,
                "pandas_type": kind,
                "numpy_type": stored,
                "metadata": None,
            }
            for name, kind, stored in kinds
        ],
        "pandas_version": "2.0.0",
    }
    tasks = tasks.replace_schema_metadata({"pandas": json.dumps(about)})
    tables = {
        folder / "data" / _FILE: data,
        folder / "meta" / "episodes" / _FILE: pyarrow.Table.from_pylist(rows),
        folder / "meta" / "tasks.parquet": tasks,
    }
    for path, table in tables.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(table, path)
