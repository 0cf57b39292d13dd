"""What is outside the proven table is said by name, with its range and what to do."""

import pytest

from dovetail.cabinet.config import CabinetConfig
from dovetail.cabinet.faults import parse_faults
from dovetail.cabinet.proven import find_unproven
from dovetail.commands.cabinet import Cabinet


@pytest.mark.parametrize("twin", ["easy", "medium", "hard"])
@pytest.mark.parametrize("period", [0.001, 0.002, 0.005])
def test_the_shipped_twins_are_inside_the_table(twin, period):
    command = Cabinet.of(twin=twin, period=period, control="none")
    plant = command._build_plant()
    config = command.settings()
    assert find_unproven(config, parse_faults("none"), plant.command_delay) == []


@pytest.mark.parametrize(
    ("settings", "faults", "delay", "message"),
    [
        ({"period": 0.003}, "none", 0.0, "period is 3 ms between two commands"),
        ({"receive_multiplier": 2}, "none", 0.0, "period is 10 ms between"),
        ({}, "none", 0.015, "delay is 15 ms of the twin and 0 ms of the faults"),
        ({}, "delay=3ms", 0.005, "5 ms of the twin and 6 ms of the faults"),
        ({}, "delay=4ms,jitter=9ms,direction=to_client", 0.0, "13 ms of the faults"),
    ],
)
def test_what_is_outside_is_named(settings, faults, delay, message):
    config = CabinetConfig.of(**settings)
    (text,) = find_unproven(config, parse_faults(faults), delay)
    assert message in text
    assert "proven for" in text
