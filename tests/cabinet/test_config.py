"""Settings of the cabinet, addresses, durations, signals."""

import re

import pytest

from dovetail.cabinet.config import (
    CabinetConfig,
    Endpoint,
    parse_endpoint,
)
from dovetail.cabinet.protocol import IoDirection, IoType
from dovetail.cabinet.signals import Signal, SignalTable, parse_signal
from dovetail.durations import parse_duration
from dovetail.errors import ConfigError


@pytest.mark.parametrize(
    ("text", "value"),
    [("5ms", 0.005), ("0.2s", 0.2), ("250us", 0.00025), ("2 min", 120.0), ("0s", 0.0)],
)
def test_durations_carry_their_unit(text, value):
    assert parse_duration(text, "time") == pytest.approx(value)


@pytest.mark.parametrize("text", ["5", "ms", "", "5 hours", "nan s", "1e999s", "--1s"])
def test_a_duration_without_unit_or_number_is_refused(text):
    with pytest.raises(ConfigError, match=r"time is .* give a number and its unit"):
        parse_duration(text, "time")


def test_endpoints_are_host_and_port():
    endpoint = parse_endpoint("127.0.0.1:30200", "client")
    assert endpoint == Endpoint("127.0.0.1", 30200)
    assert str(endpoint) == "127.0.0.1:30200"


@pytest.mark.parametrize("text", ["127.0.0.1", ":30200", "host:", "host:-1", "h:port"])
def test_what_is_no_endpoint_is_refused(text):
    with pytest.raises(ConfigError, match=r"client is .* give HOST:PORT"):
        parse_endpoint(text, "client")


def test_a_port_out_of_range_is_refused():
    with pytest.raises(ConfigError, match="port 65536; allowed is 0 to 65535"):
        parse_endpoint("host:65536", "client")


@pytest.mark.parametrize("period_ms", [1, 2, 5, 10, 100])
def test_whole_milliseconds_are_periods(period_ms):
    pace = CabinetConfig(period=1e-3 * period_ms)
    assert pace.period_ms == period_ms
    assert pace.period == 1e-3 * period_ms


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": 0.0}, "send period is 0 ms; allowed are whole ms, 1 to 100"),
        ({"period": -0.005}, "send period is -5 ms"),
        ({"period": 0.0025}, "2.5 ms; allowed are whole ms, 1 to 100, as on the wire"),
        ({"period": 0.101}, "send period is 101 ms"),
        ({"period": float("nan")}, "period is nan"),
        ({"version": "3.0"}, "'3.0' is unknown; known versions: 1.15, 2.5, 2.7"),
        ({"clock": "sun"}, "known: wall, lockstep"),
        ({"receive_multiplier": 0}, "receive_multiplier is 0; allowed: 1 to"),
        ({"hold_slots": -1}, "hold_slots is -1"),
        ({"hold_slots": 5, "stop_slots": 4}, "stop_slots is 4, less than hold_slots 5"),
        ({"mirror_tolerance": -0.1}, "mirror_tolerance is -0.1 rad; allowed: 0 to"),
        ({"patience": 0.0}, "patience is 0 s"),
        ({"restart_delay": -1.0}, "restart_delay is -1 s"),
        ({"stiffness": (1.0,) * 6}, "stiffness has shape (6,); give 7 values"),
        ({"stiffness": (-1.0,) * 7}, "stiffness[A1] is -1 Nm/rad"),
        ({"damping": (0.0,) * 6 + (1.5,)}, "damping[A7] is 1.5; allowed: 0 to 1"),
        ({"transformations": ("a",) * 6}, "6 transformations; FRI carries 5 at most"),
        ({"transformations": ("a", "a")}, "transformation 'a' is registered twice"),
        ({"transformations": ("x" * 64,)}, "has 64 bytes; allowed are 1 to 63"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(change, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        CabinetConfig(**change)


def test_signals_are_read():
    signal = parse_signal("FRI.Out_Analog:analog:output=1.5")
    assert signal == Signal("FRI.Out_Analog", IoType.ANALOG, IoDirection.OUTPUT, 1.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("FRI.Out", "give NAME:TYPE:DIRECTION"),
        (":digital:output", "give NAME:TYPE:DIRECTION"),
        ("FRI.Out:float:output", "known types are boolean, digital, analog"),
        ("FRI.Out:digital:up", "known directions are input, output"),
        ("FRI.Out:digital:output=many", "value 'many' is no number"),
    ],
)
def test_a_wrong_signal_is_refused(text, message):
    with pytest.raises(ConfigError, match=message):
        parse_signal(text)


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["a:digital:output"] * 2, "IO signal 'a' is registered twice"),
        ([f"s{i}:digital:output" for i in range(11)], "11 IO signals; FRI carries 10"),
        (["a:digital:output=0.5"], "is digital and cannot start at 0.5"),
        (["a:boolean:output=2"], "is boolean and cannot start at 2"),
        (["a:digital:output=-1"], "cannot start at -1"),
        (["a:analog:output=nan"], "cannot start at nan"),
    ],
)
def test_signals_that_a_message_cannot_carry_are_refused(texts, message):
    with pytest.raises(ConfigError, match=message):
        CabinetConfig(io=tuple(parse_signal(text) for text in texts))


@pytest.mark.parametrize(
    ("kind", "value", "fits"),
    [
        (IoType.BOOLEAN, 1, True),
        (IoType.BOOLEAN, 2, False),
        (IoType.DIGITAL, 2**64 - 1, True),
        (IoType.DIGITAL, 2**64, False),
        (IoType.ANALOG, -1.5, True),
        (IoType.ANALOG, float("inf"), False),
        (IoType.ANALOG, None, False),
    ],
)
def test_written_values_must_fit_their_type(kind, value, fits):
    table = SignalTable([Signal("a", kind, IoDirection.OUTPUT)])
    assert table.write("a", kind, IoDirection.OUTPUT, value) is fits
    assert bool(table.last_refusal) is not fits
