"""What is outside the proven table is said by name, with its range and what to do."""

from dataclasses import replace

import pytest

from dovetail.cabinet.config import CabinetConfig
from dovetail.cabinet.faults import parse_faults
from dovetail.cabinet.proven import find_unproven
from dovetail.commands.cabinet import Cabinet
from dovetail.plants.twin import load_twin


@pytest.mark.parametrize("twin", ["easy", "medium", "hard"])
@pytest.mark.parametrize("period", [0.001, 0.002, 0.005])
def test_the_shipped_twins_are_inside_the_table(twin, period):
    command = Cabinet(twin=twin, period=period, control="none")
    config = command.settings()
    assert find_unproven(config, parse_faults("none"), load_twin(twin)) == []


def test_nothing_is_said_of_an_arm_as_the_model_says():
    assert find_unproven(CabinetConfig(), parse_faults("none"), None) == []


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
    config, twin = CabinetConfig(**settings), load_twin("easy")
    twin = replace(twin, command_delay=delay)
    (text,) = find_unproven(config, parse_faults(faults), twin)
    assert message in text
    assert "proven for" in text


def test_a_twins_masses_are_named_as_evaluate_names_them():
    """The delay alone was looked at: a link of 220 % was played without a word."""
    masses = (1.0, 2.2, *(1.0,) * 5)
    twin = replace(load_twin("easy"), mass_scale=masses, command_delay=0.015)
    mass, delay = find_unproven(CabinetConfig(), parse_faults("none"), twin)
    assert mass == twin.unproven()["mass_scale"]
    assert "the error of a link's mass is 120 %" in mass
    assert "delay is 15 ms of the twin" in delay
