"""Output folders and files are whole or absent."""

import errno
import os

import pytest

from dovetail.errors import ConfigError, LogError
from dovetail.files import claim_output_folder, open_lock, write_atomic


def test_a_new_folder_is_made_with_its_parents(tmp_path):
    folder = claim_output_folder(tmp_path / "a" / "b")
    assert folder.is_dir()


def test_an_empty_folder_is_taken(tmp_path):
    assert claim_output_folder(tmp_path) == tmp_path


def test_a_folder_that_holds_something_is_refused_by_name(tmp_path):
    (tmp_path / "old.json").touch()
    with pytest.raises(ConfigError, match=r"not empty \(it holds old\.json\)"):
        claim_output_folder(tmp_path)


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path):
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(ConfigError, match="is a file"):
        claim_output_folder(file)
    with pytest.raises(ConfigError, match="cannot create"):
        claim_output_folder(file / "below")


def test_a_written_file_replaces_the_old_one(tmp_path):
    path = tmp_path / "report.json"
    write_atomic(path, "old")
    write_atomic(path, b"new")
    assert path.read_bytes() == b"new"
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, call):
    path = tmp_path / "report.json"
    write_atomic(path, "old")

    def fail(*_args, **_options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    if call == "fsync":
        monkeypatch.setattr(os, "fsync", fail)
    else:
        monkeypatch.setattr("pathlib.Path.replace", fail)
    with pytest.raises(LogError, match=r"report\.json \(3 bytes\): No space left"):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]


@pytest.mark.timeout(10)
def test_a_lock_that_leads_elsewhere_is_refused_and_nothing_is_emptied(tmp_path):
    other, link, pipe = (tmp_path / name for name in ("other", "link", "pipe"))
    other.write_text("mine")
    link.symlink_to(other)
    os.mkfifo(pipe)
    for path in (link, pipe, tmp_path):
        with pytest.raises(ConfigError):
            open_lock(path)
    open_lock(other).close()
    assert other.read_text() == "mine"
