"""The log of one episode: every control cycle, columns with units, one file.

NPZ by default, Parquet where pyarrow is installed (by the file's suffix). A file is
written beside its place and renamed there: it is whole or absent. Reading executes
nothing (no pickle) and checks everything.
"""

import json
import os
import signal
import tempfile
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType, TracebackType
from typing import IO, Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from dovetail.archives import open_zip, read_array
from dovetail.distribution import installed_version
from dovetail.errors import LogError, MissingDependencyError, install_command
from dovetail.plants.plant import CYCLE_COLUMNS, CYCLE_UNITS
from dovetail.reading import TEXT_BYTES, open_regular, parse_json
from dovetail.types import Array

FORMAT = 1
LOG_BYTES = 300_000_000
"""Largest log that is read, unpacked [bytes]: about 9 minutes at 1 ms, 45 at 5 ms.

Reading needs twice as much memory at worst. An episode of 10 s has 6 MB at 1 ms.
"""

OBSERVED = (
    *(f"obs_q{i}" for i in range(1, 8)),
    *("obs_x", "obs_y", "obs_z", "obs_theta", "obs_vx", "obs_vy", "obs_vz"),
)
"""Columns of the usual observation, unscaled; present where they were given."""
LED = "is_intervention"
"""Column that says whether a person's action was taken, 1, or a policy's, 0."""

_Handler: TypeAlias = Callable[[int, FrameType | None], Any] | int | None

_UNITS = CYCLE_UNITS | dict.fromkeys(("step", "reward", LED), "1")
_UNITS |= {f"obs_{name}": unit for name, unit in CYCLE_UNITS.items()}
_UNITS |= dict.fromkeys(("obs_theta", "obs_tilt_x", "obs_tilt_y"), "rad")
_UNITS |= dict.fromkeys((f"obs_mouth_{axis}" for axis in "xyz"), "m")
_PARTS = {"hinge_": "rad", "screw_": "rad", "slide_": "m"}
"""Units of the joints of parts, by what the names of their columns begin with."""
_WRENCH = tuple(name for name in CYCLE_COLUMNS if name.startswith("wrench_"))
_MAY_BE_NAN = ("fx", "fy", "fz", *_WRENCH)  # what an arm or an old log does not know
_NAME_BYTES = 1_000_000
"""Most that the names of the columns, or their units, may take [bytes]."""


def unit_of(column: str) -> str:
    """Return the unit of a log column.

    Raises:
        LogError: No such column.
    """
    for kind, unit in _PARTS.items():
        if column.removeprefix("obs_").startswith(kind):
            return unit
    is_action = column.removeprefix("action").isdecimal()
    if not is_action and column not in _UNITS:
        raise LogError(
            f"unknown log column {column!r}; known: {', '.join(CYCLE_COLUMNS)}, step, "
            f"action1.., reward, {LED}, {'.., '.join(_PARTS)}.., {', '.join(OBSERVED)}"
        )
    return "1" if is_action else _UNITS[column]


def log_columns(
    num_actions: int,
    observed: Sequence[str] = (),
    *,
    is_led: bool = False,
    parts: Sequence[str] = (),
) -> tuple[str, ...]:
    """Return a log's columns.

    Args:
        num_actions: Number of actions.
        observed: Names `obs_...`.
        is_led: With `LED`.
        parts: Names of the joints of parts, as `hinge_...` or `slide_...`.
    """
    actions = tuple(f"action{i + 1}" for i in range(num_actions))
    led = (LED,) if is_led else ()
    return (*CYCLE_COLUMNS, "step", *actions, "reward", *led, *parts, *observed)


class Episode:
    """Everything that happened in one episode, at the control rate.

    As a context manager with a `path` it writes what it has when the block ends,
    also by an exception or SIGTERM.
    """

    def __init__(
        self,
        *,
        metadata: Mapping[str, Any],
        path: str | Path | None = None,
        observed: Sequence[str] = OBSERVED,
        parts: Sequence[str] = (),
    ) -> None:
        """Start an empty log.

        Args:
            metadata: Plain data (robot, task, seed, ...); versions, date and format are
                added.
            path: File to write when used as a context manager.
            observed: Names of the observation's columns, where there is one.
            parts: Names of the joints of parts: `Joint.column`.
        """
        facts = {
            "format": FORMAT,
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "versions": {n: installed_version(n) for n in ("dovetail", "numpy")},
        }
        self.metadata: dict[str, Any] = facts | dict(metadata)
        self.columns: tuple[str, ...] = ()
        self._path = Path(path) if path is not None else None
        self._observed, self._parts = tuple(observed), tuple(parts)
        self._blocks: list[Array] = []
        self._before: _Handler = None

    def __len__(self) -> int:
        """Number of rows: control cycles."""
        return sum(len(block) for block in self._blocks)

    def append(
        self,
        log: Array,
        step: int,
        action: ArrayLike,
        reward: float,
        observation: ArrayLike | None = None,
        *,
        is_intervention: bool | None = None,
        parts: ArrayLike = (),
    ) -> None:
        """Add one policy step.

        Args:
            log: The step's control cycles, columns `CYCLE_COLUMNS`.
            step: Number of the step, from 0.
            action: The policy's action in [-1, 1].
            reward: The step's reward.
            observation: The unscaled observation after the step, in the columns that
                the log was made with.
            is_intervention: Whether the action was a person's; None does not say.
            parts: Positions of the joints of parts after the step [rad, m]; empty
                where they are not known: they become not-a-number.

        Raises:
            LogError: A shape differs from `CYCLE_COLUMNS` or from the first step's.
        """
        numbers = np.asarray(action, dtype=float).ravel()
        observed = () if observation is None else np.asarray(observation, dtype=float)
        names = () if observation is None else self._observed
        led = [] if is_intervention is None else [float(is_intervention)]
        columns = log_columns(len(numbers), names, is_led=bool(led), parts=self._parts)
        self.columns = self.columns or columns
        moved = np.asarray(parts, dtype=float)
        moved = moved if len(moved) else np.full(len(self._parts), np.nan)
        extra = np.concatenate([[step], numbers, [reward], led, moved, observed])
        width = log.shape[1] + len(extra) if log.ndim == 2 else 0
        if width != len(columns) or columns != self.columns:
            raise LogError(
                f"step {step}: a log of shape {log.shape}, {len(numbers)} actions and "
                f"{len(observed)} observations do not make the episode's "
                f"{len(self.columns)} columns; give every step the same"
            )
        self._blocks.append(np.hstack([log, np.tile(extra, (len(log), 1))]))

    @property
    def data(self) -> Array:
        """All rows, shape (cycles, columns)."""
        if not self._blocks:
            return np.empty((0, len(self.columns)))
        if len(self._blocks) > 1:
            self._blocks = [np.vstack(self._blocks)]
        return self._blocks[0]

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each column."""
        return tuple(unit_of(column) for column in self.columns)

    def __getitem__(self, column: str) -> Array:
        """Return one column by name, shape (cycles,).

        Raises:
            LogError: No such column; lists the log's.
        """
        if column not in self.columns:
            raise LogError(
                f"the log has no column {column!r}; it has {', '.join(self.columns)}"
            )
        return self.data[:, self.columns.index(column)]

    def save(self, path: str | Path) -> Path:
        """Write the log: Parquet if the suffix is .parquet, else NPZ.

        Returns:
            `path`.

        Raises:
            LogError: The disk is full or not writable; a file that was there before
                stays as it was, and the log stays in memory.

        Warns:
            UserWarning: The log is too large for `load`.
        """
        path = Path(path)
        if (size := self.data.nbytes) > LOG_BYTES:
            warnings.warn(
                f"the log {path} has {size} bytes of numbers, and a log is read up to "
                f"{LOG_BYTES}: use NumPy or pyarrow to read it, or shorter episodes",
                stacklevel=2,
            )
        write = _write_parquet if path.suffix == ".parquet" else _write_npz
        beside = None
        try:
            with tempfile.NamedTemporaryFile(
                dir=path.parent, prefix=f".{path.name}.", delete=False
            ) as file:
                beside = Path(file.name)
                write(self, file.file)
                file.flush()
                os.fsync(file.fileno())
            beside.chmod(0o644)
            beside.replace(path)
        except OSError as error:
            was = "is as it was before" if path.exists() else "does not exist"
            raise LogError(
                f"cannot write the log {path} ({len(self)} cycles): "
                f"{error.strerror or error}; the file {was}, nothing half-written is "
                "left; free some space, then run it again (a program that still has "
                "the log can save it again)"
            ) from error
        finally:
            if beside is not None:
                beside.unlink(missing_ok=True)
        return path

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a log and check it.

        Raises:
            LogError: Missing, damaged, of another format, or with wrong columns, units
                or numbers; says which.
            MissingDependencyError: A Parquet file and no pyarrow.
        """
        path = Path(path)
        read = _read_parquet if path.suffix == ".parquet" else _read_npz
        try:
            data, columns, units, text = read(path)
            metadata = parse_json(text, "its metadata")
        except MissingDependencyError:
            raise
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else None
            raise LogError(
                f"the log {path} cannot be read: {reason or error}; it is missing, cut "
                "short or no dovetail log"
            ) from error
        if not isinstance(metadata, dict) or metadata.get("format") != FORMAT:
            found = metadata.get("format") if isinstance(metadata, dict) else None
            raise LogError(
                f"the log {path} has format {found}; this version reads {FORMAT}"
            )
        data, columns, units = _with_wrench(data, columns, units)
        _check(path, data, columns, units)
        episode = cls(metadata=metadata)
        episode.columns = columns
        episode._blocks = [data]
        return episode

    def __enter__(self) -> Self:
        """Turn SIGTERM into an exit that still writes."""
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGTERM, _exit_on_signal)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write what was logged, however the block ended."""
        try:
            if self._path is not None:
                if kind is not None:
                    self.metadata["ended_by"] = f"{kind.__name__}: {error}"
                self.save(self._path)
        finally:
            if self._before is not None:
                signal.signal(signal.SIGTERM, self._before)
                self._before = None


def _exit_on_signal(number: int, _: FrameType | None) -> None:
    raise SystemExit(128 + number)


def _with_wrench(
    data: Array, columns: tuple[str, ...], units: tuple[str, ...]
) -> tuple[Array, tuple[str, ...], tuple[str, ...]]:
    """Return an old log with the columns of the wrench, which it did not know."""
    at = len(CYCLE_COLUMNS) - len(_WRENCH)
    is_old = columns[:at] == CYCLE_COLUMNS[:at] and not {*columns} & {*_WRENCH}
    if not is_old or data.ndim != 2 or data.shape[1:] != (len(columns),):
        return data, columns, units
    unknown = np.full((len(data), len(_WRENCH)), np.nan)
    return (
        np.hstack([data[:, :at], unknown, data[:, at:]]),
        (*columns[:at], *_WRENCH, *columns[at:]),
        (*units[:at], *map(unit_of, _WRENCH), *units[at:]),
    )


def _check(
    path: Path, data: Array, columns: tuple[str, ...], units: tuple[str, ...]
) -> None:
    """Refuse a log whose columns, units or numbers are not what they should be."""
    num_actions = sum(name.startswith("action") for name in columns)
    observed = [name for name in columns if name.startswith("obs_")]
    parts = [name for name in columns if name.startswith(tuple(_PARTS))]
    wanted = log_columns(num_actions, observed, is_led=LED in columns, parts=parts)
    if (columns and columns != wanted) or len(set(columns)) < len(columns):
        raise LogError(
            f"the log {path} has the columns {', '.join(columns)}; expected "
            f"{', '.join(wanted)}, each once"
        )
    if data.dtype != np.float64 or data.ndim != 2 or data.shape[1] != len(columns):
        raise LogError(
            f"the log {path} has data of shape {data.shape} and type {data.dtype}; "
            f"its {len(columns)} columns need (cycles, {len(columns)}) float64"
        )
    if len(units) != len(columns):
        raise LogError(
            f"the log {path} has {len(units)} units for {len(columns)} columns"
        )
    for name, unit, values in zip(columns, units, data.T, strict=True):
        if unit != unit_of(name):
            raise LogError(
                f"the log {path}: column {name} is in {unit!r}, expected "
                f"{unit_of(name)!r}"
            )
        may_be_nan = name in _MAY_BE_NAN or name in parts
        bad = np.isinf(values) if may_be_nan else ~np.isfinite(values)
        if bad.any():
            row = int(np.argmax(bad))
            raise LogError(
                f"the log {path}: column {name} is {values[row]} in row {row}; it must "
                "be finite"
            )
    if len(data) > 1 and not (np.diff(data[:, 0]) > 0.0).all():
        row = int(np.argmin(np.diff(data[:, 0]) > 0.0)) + 1
        raise LogError(f"the log {path}: time does not increase at row {row}")


_Parts: TypeAlias = tuple[Array, tuple[str, ...], tuple[str, ...], str]


def _metadata_text(episode: Episode) -> str:
    return json.dumps(episode.metadata, default=_plain)


def _plain(value: Any) -> Any:
    """Return what JSON can hold for arrays, NumPy numbers and paths."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return str(value)


def _write_npz(episode: Episode, file: IO[bytes]) -> None:
    np.savez(
        file,
        data=episode.data,
        columns=np.array(episode.columns, dtype=str),
        units=np.array(episode.units, dtype=str),
        metadata=np.array(_metadata_text(episode)),
    )


def _read_npz(path: Path) -> _Parts:
    with open_zip(path, LOG_BYTES) as archive:
        columns = _texts(read_array(archive, "columns", _NAME_BYTES))
        units = _texts(read_array(archive, "units", _NAME_BYTES))
        metadata = read_array(archive, "metadata", 4 * TEXT_BYTES)
        if metadata.shape != ():
            raise ValueError(f"metadata has shape {metadata.shape}")
        data = read_array(archive, "data")
    return data, columns, units, str(metadata)


def _texts(array: np.ndarray[Any, Any]) -> tuple[str, ...]:
    if array.ndim != 1:
        raise ValueError(f"columns or units have shape {array.shape}")
    return tuple(str(text) for text in array)


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet as parquet
    except ImportError as error:
        raise MissingDependencyError(
            f"a Parquet log needs pyarrow: {install_command('log')}, or use the suffix "
            ".npz"
        ) from error
    return pyarrow, parquet


def _write_parquet(episode: Episode, file: IO[bytes]) -> None:
    pyarrow, parquet = _pyarrow()
    fields = [
        pyarrow.field(name, pyarrow.float64(), metadata={"unit": unit})
        for name, unit in zip(episode.columns, episode.units, strict=True)
    ]
    schema = pyarrow.schema(fields, metadata={"dovetail": _metadata_text(episode)})
    columns = [np.ascontiguousarray(values) for values in episode.data.T]
    parquet.write_table(pyarrow.Table.from_arrays(columns, schema=schema), file)


def _read_parquet(path: Path) -> _Parts:
    pyarrow, parquet = _pyarrow()
    with open_regular(path, LOG_BYTES) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - 8))
        footer = int.from_bytes(file.read(8)[:4], "little")
        if footer > TEXT_BYTES:  # pyarrow takes many times its size in memory
            raise ValueError(f"its footer has {footer} bytes")
        try:
            table = parquet.ParquetFile(file, thrift_container_size_limit=10_000)
            text, columns, units = _schema_of(table)
            _require_sizes(table, size)
            data = _rows_of(table, len(columns))
        except pyarrow.ArrowException as error:
            raise ValueError(str(error)[:500]) from error
    return data, columns, units, text


def _schema_of(file: Any) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
    """Return metadata, columns and units of a Parquet file."""
    schema = file.schema_arrow
    text = (schema.metadata or {}).get(b"dovetail", b"").decode()
    columns = tuple(schema.names)
    if len(columns) > 10 * len(CYCLE_COLUMNS):
        raise ValueError(f"it has {len(columns)} columns")
    if strange := [str(f.type)[:40] for f in schema if str(f.type) != "double"]:
        raise ValueError(f"it has columns of type {strange[0]}; allowed: double")
    units = tuple((f.metadata or {}).get(b"unit", b"").decode() for f in schema)
    return text, columns, units


def _require_sizes(file: Any, size: int) -> None:
    """Refuse a Parquet file whose pages can be much larger than their numbers.

    A page is unpacked whole. Snappy makes at most 21 bytes of one, so that a packed
    column that is not larger than its numbers bounds the memory; other methods do not.
    """
    about = file.metadata
    numbers = about.num_rows * about.num_columns * 8
    if numbers > LOG_BYTES:
        raise ValueError(f"it unpacks to {numbers} bytes; allowed: up to {LOG_BYTES}")
    if about.num_columns < len(CYCLE_COLUMNS) - len(_WRENCH) and about.num_rows:
        raise ValueError(f"it has {about.num_columns} columns")
    for group in map(about.row_group, range(about.num_row_groups)):
        for column in map(group.column, range(group.num_columns)):
            packed = column.total_compressed_size
            most = 100_000 + 10 * about.num_rows
            if column.compression not in ("SNAPPY", "UNCOMPRESSED"):
                raise ValueError(
                    f"it is packed by {column.compression}; allowed: SNAPPY or nothing"
                )
            if not 0 <= packed <= min(most, size):
                raise ValueError(f"a column has {packed} bytes; allowed: up to {most}")


def _rows_of(file: Any, num_columns: int) -> Array:
    """Return the numbers of a Parquet file, as many rows as it declares."""
    count, begin = file.metadata.num_rows, 0
    data = np.empty((count, num_columns))
    for batch in file.iter_batches(batch_size=10_000, use_threads=False):
        end = begin + batch.num_rows
        if end > count or batch.num_columns != num_columns:
            raise ValueError(f"it has more than the {count} rows that it declares")
        for i, column in enumerate(batch.columns):
            data[begin:end, i] = column.to_numpy(zero_copy_only=False)
        begin = end
    if begin < count:
        raise ValueError(f"it has {begin} of the {count} rows that it declares")
    return data
