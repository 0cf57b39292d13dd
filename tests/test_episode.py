import errno
import json
import os
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from dovetail.episode import OBSERVED, Episode, log_columns, unit_of
from dovetail.errors import LogError
from dovetail.plants.plant import CYCLE_COLUMNS
from extras import need


def cycles(count, start=0.0, rng=None):
    rng = rng or np.random.default_rng(0)
    log = rng.normal(size=(count, len(CYCLE_COLUMNS)))
    log[:, 0] = start + 0.005 * np.arange(count)
    return log


def make_episode(num_steps=3, observation=None, **metadata):
    episode = Episode(metadata={"task": "XYZ:force", "seed": 1} | metadata)
    for step in range(num_steps):
        log = cycles(10, 0.05 * step)
        episode.append(log, step, [0.1, 0.2, 0.3, 0.4], -0.5, observation)
    return episode


@pytest.mark.parametrize("suffix", [".npz", ".parquet"])
def test_a_saved_log_loads_with_the_same_numbers_columns_units_and_metadata(
    tmp_path, suffix
):
    if suffix == ".parquet":
        need("pyarrow")
    episode = make_episode(observation=np.arange(14.0))
    path = episode.save(tmp_path / f"log{suffix}")
    loaded = Episode.load(path)
    np.testing.assert_array_equal(loaded.data, episode.data)
    assert loaded.columns == log_columns(4, OBSERVED)
    assert loaded.units == episode.units
    assert loaded.metadata == episode.metadata
    np.testing.assert_array_equal(loaded["step"], np.repeat([0, 1, 2], 10))
    np.testing.assert_array_equal(loaded["obs_x"], np.full(30, 7.0))
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_every_column_has_a_unit():
    assert all(unit_of(name) for name in log_columns(6, OBSERVED, is_led=True))
    assert (unit_of("tau3"), unit_of("fsx"), unit_of("obs_vx")) == ("Nm", "m/s2", "m/s")
    with pytest.raises(LogError, match="unknown log column 'torque'"):
        unit_of("torque")


def test_observed_columns_are_the_environments():
    from dovetail.envs.observation import GROUPS, USUAL_GROUPS

    columns = [column for name in USUAL_GROUPS for column in GROUPS[name].columns]
    assert [(name, unit_of(name)) for name in OBSERVED] == [c[:2] for c in columns]


def test_a_log_is_written_when_the_block_dies_by_an_exception(tmp_path):
    path = tmp_path / "log.npz"

    def die():
        with Episode(metadata={}, path=path) as episode:
            episode.append(cycles(10), 0, [0.0], 0.0)
            raise ZeroDivisionError("division by zero")

    with pytest.raises(ZeroDivisionError):
        die()
    loaded = Episode.load(path)
    assert len(loaded) == 10
    assert loaded.metadata["ended_by"] == "ZeroDivisionError: division by zero"


def test_a_log_is_written_when_the_process_is_terminated(tmp_path):
    path = tmp_path / "log.npz"
    program = f"""
        import os, signal, time
        import numpy as np
        from dovetail.episode import Episode
        from dovetail.plants.plant import CYCLE_COLUMNS
        with Episode(metadata={{}}, path={str(path)!r}) as episode:
            log = np.zeros((10, len(CYCLE_COLUMNS)))
            log[:, 0] = np.arange(10)
            episode.append(log, 0, [0.0], 0.0)
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(30)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], timeout=60, check=False
    )
    assert done.returncode == 128 + signal.SIGTERM
    assert len(Episode.load(path)) == 10


def test_the_old_signal_handler_is_back_after_the_block(tmp_path):
    before = signal.getsignal(signal.SIGTERM)
    with Episode(metadata={}, path=tmp_path / "log.npz"):
        assert signal.getsignal(signal.SIGTERM) is not before
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_full_disk_is_a_log_error_that_keeps_the_old_file(tmp_path, monkeypatch):
    path = make_episode(num_steps=1).save(tmp_path / "log.npz")
    before = path.read_bytes()
    episode = make_episode(num_steps=2)

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(LogError, match=r"log\.npz .20 cycles.: No space left") as found:
        episode.save(path)
    assert "is as it was before" in str(found.value)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["log.npz"]
    monkeypatch.undo()
    assert len(Episode.load(episode.save(path))) == 20


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_log_cut_short_does_not_load(tmp_path, share):
    path = make_episode().save(tmp_path / "log.npz")
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(LogError, match="cannot be read"):
        Episode.load(path)


def test_a_missing_log_is_a_log_error(tmp_path):
    with pytest.raises(LogError, match="cannot be read"):
        Episode.load(tmp_path / "absent.npz")


def test_what_is_no_log_is_not_told_to_be_trusted(tmp_path):
    (tmp_path / "log.npz").write_text("hello")
    with pytest.raises(LogError, match="not a ZIP file") as refused:
        Episode.load(tmp_path / "log.npz")
    assert "allow_pickle" not in str(refused.value)


def test_a_log_with_pickled_content_is_refused(tmp_path):
    path = tmp_path / "log.npz"
    np.savez(path, data=np.array([{"a": 1}], dtype=object))
    with pytest.raises(LogError, match="cannot be read"):
        Episode.load(path)


def rewrite(path, **changes):
    with np.load(path) as arrays:
        content = dict(arrays) | changes
    np.savez(path, **content)
    return path


def damaged(path, what):
    with np.load(path) as arrays:
        data, columns, units = arrays["data"], arrays["columns"], arrays["units"]
    if what == "columns":
        return {"columns": np.array(["torque", *columns[1:]])}
    if what == "units":
        return {"units": np.array(["ms", *units[1:]])}
    if what == "lengths":
        return {"data": data[:, :-1]}
    if what == "nan":
        data[4, 3] = np.nan
    if what == "time":
        data[7, 0] = data[6, 0]
    if what == "format":
        return {"metadata": np.array(json.dumps({"format": 99}))}
    return {"data": data}


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("columns", "has the columns torque"),
        ("units", "column time is in 'ms', expected 's'"),
        ("lengths", "has data of shape"),
        ("nan", "column q3 is nan in row 4"),
        ("time", "time does not increase at row 7"),
        ("format", "has format 99; this version reads 1"),
    ],
)
def test_a_wrong_log_is_refused_and_the_message_says_why(tmp_path, what, message):
    path = make_episode().save(tmp_path / "log.npz")
    rewrite(path, **damaged(path, what))
    with pytest.raises(LogError, match=message):
        Episode.load(path)


def test_contact_forces_that_cannot_be_measured_are_not_a_number(tmp_path):
    episode = Episode(metadata={})
    log = cycles(5)
    log[:, CYCLE_COLUMNS.index("fx")] = np.nan
    episode.append(log, 0, [0.0], 0.0)
    loaded = Episode.load(episode.save(tmp_path / "log.npz"))
    assert np.isnan(loaded["fx"]).all()


@pytest.mark.parametrize("suffix", ["npz", "parquet"])
def test_a_log_from_before_the_wrench_is_one_without_it(tmp_path, suffix):
    if suffix == "parquet":
        need("pyarrow")
    episode = make_episode()
    path = episode.save(tmp_path / f"log.{suffix}")
    is_old = [not name.startswith("wrench_") for name in episode.columns]
    kept = [name for name in episode.columns if not name.startswith("wrench_")]
    if suffix == "npz":
        with np.load(path) as arrays:
            rows = dict(arrays)
        rows["data"] = rows["data"][:, is_old]
        rows |= {name: rows[name][is_old] for name in ("columns", "units")}
        np.savez(path, **rows)
    else:
        from pyarrow import parquet

        parquet.write_table(parquet.read_table(path).select(kept), path)
    loaded = Episode.load(path)
    assert loaded.columns == episode.columns
    assert loaded.units == episode.units
    for name in episode.columns:
        expected = episode[name] if name in kept else np.full(len(episode), np.nan)
        np.testing.assert_array_equal(loaded[name], expected)


def test_steps_of_different_shape_are_refused():
    episode = make_episode(num_steps=1)
    with pytest.raises(LogError, match="step 1: a log of shape"):
        episode.append(cycles(10, 1.0), 1, [0.0], 0.0)
    with pytest.raises(LogError, match="step 1: a log of shape"):
        episode.append(np.zeros((10, 3)), 1, [0.0] * 4, 0.0)


def test_an_unknown_column_lists_the_known_ones():
    with pytest.raises(LogError, match="no column 'depth'; it has time, q1"):
        make_episode()["depth"]


def test_an_empty_log_can_be_saved_and_loaded(tmp_path):
    loaded = Episode.load(Episode(metadata={}).save(tmp_path / "log.npz"))
    assert len(loaded) == 0
