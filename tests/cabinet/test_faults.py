"""How faults are written, and what they do to datagrams."""

import itertools
import re

import pytest

from dovetail.cabinet.faults import FaultConfig, parse_faults, read_script
from dovetail.cabinet.link import Link
from dovetail.cabinet.protocol import Quality
from dovetail.errors import ConfigError
from dovetail.settings import names_in, values_of
from facts import about

EXAMPLES = {
    "loss": ("0.02", 0.02),
    "duplicate": ("0.05", 0.05),
    "reorder": ("0.05", 0.05),
    "corrupt": ("0.01", 0.01),
    "truncate": ("1", 1.0),
    "delay": ("3ms", 0.003),
    "jitter": ("500us", 0.0005),
    "direction": ("to_client", "to_client"),
    "freeze": ("0.2s", 0.2),
    "quality": ("poor", Quality.POOR),
    "stop_at": ("2s", 2.0),
    "stop": ("3", 3),
    "stop_time": ("1s", 1.0),
    "values": ("6", 6),
    "seed": ("7", 7),
}


def test_every_fault_has_an_example_here():
    assert set(EXAMPLES) == set(names_in(FaultConfig))


@pytest.mark.parametrize("name", EXAMPLES)
def test_each_fault_is_read(name):
    text, value = EXAMPLES[name]
    given = values_of(parse_faults(f"{name}={text}"))[name]
    assert given == pytest.approx(value)
    assert given != values_of(FaultConfig())[name]


def test_faults_are_read_together_and_none_is_none():
    text = "loss=0.02, duplicate=0.05,delay=3ms"
    assert parse_faults(text) == FaultConfig(loss=0.02, duplicate=0.05, delay=0.003)
    assert parse_faults("none") == parse_faults("") == FaultConfig()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("los=0.1", "fault 'los' is unknown; known faults: loss, duplicate, reorder"),
        ("loss", "loss has no value"),
        ("loss=", "loss has no value"),
        ("loss=2", "fault loss is 2; allowed: 0 to 1"),
        ("loss=-0.1", "loss is -0.1; allowed: 0 to 1"),
        ("loss=nan", "loss is nan; allowed: 0 to 1"),
        ("loss=much", "loss is 'much', which is no number"),
        ("loss=0.1,loss=0.2", "given twice"),
        ("delay=3", "give a number and its unit"),
        ("delay=2s", "delay is 2 s; allowed: 0 to 1 s"),
        ("jitter=-1ms", "jitter is -0.001 s; allowed: 0 to 1 s"),
        ("quality=bad", "known: poor, fair, good, excellent"),
        ("stop=4", "stop is 4; allowed: 1 to 3"),
        ("values=7.5", "values is '7.5'; give a whole number"),
        ("direction=up", "known: both, to_client, from_client"),
    ],
)
def test_wrong_faults_are_refused_with_what_is_allowed(text, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        parse_faults(text)


def test_a_script_is_read_in_the_order_of_time(tmp_path):
    file = tmp_path / "faults.txt"
    file.write_text("# a bad second\n2s loss=0.5  # half\n\n500ms delay=2ms\n3s none\n")
    assert read_script(file) == [
        (0.5, FaultConfig(delay=0.002)),
        (2.0, FaultConfig(loss=0.5)),
        (3.0, FaultConfig()),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1s loss=2\n", "line 1: fault loss"),
        ("\nsoon loss=0.1\n", "line 2: time is 'soon'"),
        ("1s\n", "line 1: no faults"),
        ("-1s none\n", "line 1: time is -1s"),
    ],
)
def test_a_wrong_script_names_the_line(text, message, tmp_path):
    file = tmp_path / "faults.txt"
    file.write_text(text)
    with pytest.raises(ConfigError, match=re.escape(message)):
        read_script(file)


def test_a_missing_script_is_named(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        read_script(tmp_path / "nowhere.txt")


def passed(count=2000, payload=b"0123456789", **faults):
    """Send numbered datagrams one period apart; return what arrives, in order."""
    link = Link(0.005)
    link.configure(FaultConfig(**faults), "to_client")
    arrived = []
    for i in range(count):
        link.send(payload, 0.005 * i, tag=i)
        while parcel := link.take(0.005 * i):
            arrived.append((0.005 * i, parcel))
    while parcel := link.take(1e9):
        arrived.append((parcel.due, parcel))
    return arrived


def test_without_faults_everything_passes_in_order():
    arrived = passed()
    assert [parcel.tag for _, parcel in arrived] == list(range(2000))
    assert Link(0.005).is_idle


def test_loss_loses_its_share():
    assert 1700 < len(passed(loss=0.1)) < 1900


def test_duplicates_come_twice():
    arrived = passed(duplicate=0.1)
    copies = [parcel for _, parcel in arrived if parcel.tag == -1]
    assert 140 < len(copies) < 270
    assert len(arrived) == 2000 + len(copies)


def test_reordered_datagrams_come_after_the_next():
    tags = [parcel.tag for _, parcel in passed(reorder=0.1)]
    assert sorted(tags) == list(range(2000))
    swaps = sum(a > b for a, b in itertools.pairwise(tags))
    assert 120 < swaps < 250


def test_corrupt_and_truncated_datagrams_are_changed():
    for name in ("corrupt", "truncate"):
        changed = [p for _, p in passed(**{name: 0.2}) if not p.is_intact]
        assert 300 < len(changed) < 500
        assert all(p.payload != b"0123456789" for p in changed)
    assert all(len(p.payload) < 10 for p in changed)


def test_delay_and_jitter_stay_in_their_range():
    link = Link(0.005)
    link.configure(FaultConfig(delay=0.002, jitter=0.001), "to_client")
    for _ in range(100):
        link.send(b"x", 1.0)
        assert 1.002 <= link.next_due <= 1.003
        assert link.take(1.0019) is None
        assert link.take(1.0031) is not None


def test_an_empty_datagram_survives_every_fault():
    passed(payload=b"", corrupt=0.5, truncate=0.5)


def test_the_same_seed_gives_the_same_faults():
    faults = {"loss": 0.3, "reorder": 0.2, "duplicate": 0.2}
    first = [parcel.tag for _, parcel in passed(seed=1, **faults)]
    assert first == [parcel.tag for _, parcel in passed(seed=1, **faults)]
    assert first != [parcel.tag for _, parcel in passed(seed=2, **faults)]


def test_a_direction_leaves_the_other_alone():
    link = Link(0.005)
    link.configure(FaultConfig(loss=1.0, direction="from_client"), "to_client")
    assert link.is_idle
    link.configure(FaultConfig(loss=1.0, direction="from_client"), "from_client")
    assert not link.is_idle


def test_faults_that_are_made_in_python_are_checked_too():
    with pytest.raises(ConfigError, check=about("delay")):
        FaultConfig(delay=3.0)
