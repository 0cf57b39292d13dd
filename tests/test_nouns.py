"""The nouns keep their shape: short constructors, and no word of one task elsewhere."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "dovetail"
SUFFIXES = {".py", ".toml", ".cpp", ".hpp", ".proto"}


def words(text):
    """How often a text says what one task has; TypeGuard and whole do not count."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    return len(re.findall(r"(?i)(?<![a-z])(?:hole|peg)s?(?![a-z])", apart))


def test_no_room_says_hole_or_peg_but_the_task_that_has_them():
    own = [
        PACKAGE / name
        for name in ("tasks/peg_in_hole", "policies", "recipes", "reproduce")
    ]
    left = {}
    for folder in (PACKAGE, ROOT / "cpp", ROOT / "proto"):
        for path in sorted(folder.rglob("*")):
            if path.suffix in SUFFIXES and not any(map(path.is_relative_to, own)):
                left[str(path.relative_to(ROOT))] = words(path.read_text())
    assert len(left) > 200
    assert {name: count for name, count in left.items() if count} == {}
