import errno
import os

import pytest

from dovetail.errors import ConfigError
from dovetail.reading import DEPTH, read_bytes, read_json, read_toml


def test_a_file_at_the_limit_is_read_and_one_byte_more_is_refused(tmp_path):
    file = tmp_path / "file"
    file.write_bytes(b"x" * 100)
    assert read_bytes(file, 100) == b"x" * 100
    with pytest.raises(OSError, match="100 bytes") as caught:
        read_bytes(file, 99)
    assert caught.value.errno == errno.EFBIG


def test_a_sparse_file_of_a_terabyte_is_refused_unread(tmp_path):
    file = tmp_path / "file"
    with file.open("wb") as stream:
        stream.truncate(2**40)
    with pytest.raises(OSError, match="allowed"):
        read_bytes(file, 1000)


@pytest.mark.timeout(10)
def test_pipes_devices_and_folders_are_refused_at_once(tmp_path):
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to("/dev/zero")
    for path in (pipe, link):
        with pytest.raises(OSError, match="regular") as caught:
            read_bytes(path, 1000)
        assert caught.value.errno == errno.EINVAL
    with pytest.raises(IsADirectoryError):
        read_bytes(tmp_path, 1000)
    with pytest.raises(FileNotFoundError):
        read_bytes(tmp_path / "absent", 1000)


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "9" * 200_000,
        ".".join("k" * 50_000) + " = 1",
        "a = " + "[" * 3000 + "]" * 3000,
        "a.b.c = \xff",
        ".".join(['"="'] * 50_000) + " = 1",  # quotes hide the dots from a splitter
        '"#".' + ".".join("k" * 50_000) + " = 1",
        "a = [1.0, 2.0]." + ".".join("k" * 50_000),
        "a = 0x" + "f" * 17,  # 68 bits: prints, becomes a float, or neither
    ],
)
@pytest.mark.timeout(30)
def test_a_hostile_toml_is_a_config_error(tmp_path, text):
    file = tmp_path / "file.toml"
    file.write_bytes(text.encode("latin-1"))
    with pytest.raises(ConfigError):
        read_toml(file)


def test_an_array_of_many_numbers_in_one_line_is_read(tmp_path):
    file = tmp_path / "file.toml"
    file.write_text("a = [" + "-1.5e-3, " * 1000 + "0.5]\n")
    assert len(read_toml(file)["a"]) == 1001


@pytest.mark.parametrize("text", ['"\\ud800"', "1" + "0" * 400, "\xff"])
def test_a_json_that_later_code_could_not_handle_is_a_config_error(tmp_path, text):
    file = tmp_path / "file.json"
    file.write_bytes(text.encode("latin-1"))
    with pytest.raises(ConfigError):
        read_json(file)


def test_a_json_is_read_down_to_the_allowed_depth(tmp_path):
    file = tmp_path / "file.json"
    file.write_text("[" * (DEPTH + 1) + "]" * (DEPTH + 1))
    assert read_json(file)
    for text in ("[" * (DEPTH + 2) + "]" * (DEPTH + 2), "[" * 100_000, "9" * 5000, ""):
        file.write_text(text)
        with pytest.raises(ConfigError):
            read_json(file)
