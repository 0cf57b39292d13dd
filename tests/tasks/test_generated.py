"""Pairs that are drawn at random: each can be held and inserted, and comes again."""

import tomllib

import pytest

from dovetail.errors import ConfigError
from dovetail.tasks.insert.generated import KINDS, PINS, draw_pair, generate_parts
from dovetail.tasks.insert.task import Insert
from extras import need
from facts import about

need("shapely")


def test_a_seed_gives_the_same_pairs_for_any_count(tmp_path):
    few = generate_parts(tmp_path / "few", 3, seed=5)
    many = generate_parts(tmp_path / "many", 5, seed=5)
    assert [one.name for one in few] == [one.name for one in many[:3]]
    assert [one.read_text() for one in few] == [one.read_text() for one in many[:3]]
    texts = {one.read_text() for one in many}
    assert len(texts) == 5
    assert draw_pair(6, 0, KINDS[0]) not in texts
    with pytest.raises(ConfigError):
        generate_parts(tmp_path / "few", 1)


def test_each_kind_is_a_part_that_can_be_inserted(tmp_path):
    files = generate_parts(tmp_path / "pairs", 2 * len(KINDS))
    for i, file in enumerate(files):
        task = Insert(part=str(file))
        name = tomllib.loads(file.read_text())["name"]
        assert name.split()[0] == KINDS[i % len(KINDS)]
        assert task.describe()[0] == name
        assert 0.2e-3 <= task.gap() <= 0.5e-3
        assert 2e-3 <= task.depths()[0] <= 28e-3
    texts = [file.read_text() for file in files]
    assert any("through = true" in text for text in texts)
    assert any("through = false" in text for text in texts)


def test_a_plug_with_pins_is_drawn_where_it_is_asked_for(tmp_path):
    assert PINS not in KINDS
    for file in generate_parts(tmp_path / "pins", 8, kinds=(PINS,)):
        task = Insert(part=str(file))
        assert file.stem.endswith(PINS)
        assert task.outline().is_pin
        assert 0.2e-3 <= task.gap() <= 0.5e-3


def test_a_kind_that_is_not_known_is_refused(tmp_path):
    for kinds in (("pins", "gear"), ()):
        with pytest.raises(ConfigError, check=about("kinds")):
            generate_parts(tmp_path / "pairs", 1, kinds=kinds)
    assert not (tmp_path / "pairs").exists()


@pytest.mark.parametrize("count", [0, -1, 10_001])
def test_a_count_out_of_range_is_refused(count, tmp_path):
    with pytest.raises(ConfigError, check=about("count")):
        generate_parts(tmp_path / "pairs", count)
    assert not (tmp_path / "pairs").exists()
