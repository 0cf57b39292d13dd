from dataclasses import replace

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.identify.parameters import KNOWN, ParameterSet, nominal_model
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import load_twin
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.motors import Motors
from dovetail.settings import values_of


def test_the_papers_set_is_gravity_one_mass_scale_and_damping():
    names = ParameterSet.parse("paper").names
    assert names == ("gravity_x", "gravity_y", "gravity_z", "mass_scale", "damping")


def test_the_extended_set_has_every_joint_and_the_delay():
    names = ParameterSet.parse("extended").names
    assert len(names) == 3 + 4 * 7 + 1
    assert {"mass_scale_7", "damping_1", "coulomb_4", "armature_2"} < set(names)
    assert names[-1] == "command_delay"


@pytest.mark.parametrize("name", ["paper", "extended"])
def test_the_start_is_the_nominal_model(name):
    parameters = ParameterSet.parse(name)
    assert parameters.to_model(parameters.start) == nominal_model()
    assert nominal_model().dynamics() == DynamicsConfig()


@pytest.mark.parametrize("name", KNOWN)
def test_each_parameter_changes_one_field_of_the_model(name):
    parameters = ParameterSet.parse(name)
    model = parameters.to_model(parameters.high)
    given, nominal = values_of(model), values_of(nominal_model())
    differ = [name for name in given if given[name] != nominal[name]]
    assert len(differ) == 1


@pytest.mark.parametrize("name", ["paper", "extended"])
def test_the_values_in_a_model_are_those_it_was_made_of(name):
    parameters = ParameterSet.parse(name)
    vector = 0.7 * parameters.low + 0.3 * parameters.high
    model = parameters.to_model(vector)
    np.testing.assert_allclose(parameters.values_in(model), vector)


def test_a_joints_own_parameter_leaves_the_other_joints_alone():
    model = ParameterSet.parse("damping_3").to_model(np.array([1.5]))
    assert model.damping == (0.5, 0.5, 1.5, 0.5, 0.5, 0.5, 0.5)


def test_a_model_is_a_twin_file_without_noise(tmp_path):
    file = tmp_path / "model.toml"
    parameters = ParameterSet.parse("extended")
    model = parameters.to_model(0.5 * (parameters.low + parameters.high))
    file.write_text(model.to_toml())
    assert load_twin(file) == model
    noise = replace(model, torque_noise=0.0, position_noise=0.0, velocity_noise=0.0)
    assert model == noise


def test_bounds_and_start_may_follow_a_name():
    (p,) = ParameterSet.parse("mass_scale=0.8:1.2:1.05").parameters
    assert (p.low, p.high, p.start) == (0.8, 1.2, 1.05)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("inertia", "parameter 'inertia' is unknown; known: paper, extended"),
        ("", "no parameters to identify"),
        ("gravity,gravity_x", "parameter gravity_x is there twice"),
        ("damping,damping_2", "parameter damping_2 is there twice"),
        ("damping=1:2", "starts at 0.5 Nms/rad, which its bounds 1 to 2 .* exclude"),
        ("damping=2:1", "which its bounds 2 to 1 Nms/rad exclude"),
        ("damping=0", "has the bounds '0'; give LOW:HIGH"),
        ("damping=a:b", "has the bounds 'a:b'; give LOW:HIGH"),
        ("damping=0:inf", "has the bounds '0:inf'; give LOW:HIGH"),
        ("damping=0:200", "damping ends at 200 Nms/rad, allowed is 0 to 100"),
    ],
)
def test_a_set_that_cannot_be_searched_is_refused(text, message):
    with pytest.raises(ConfigError, match=message):
        ParameterSet.parse(text)


def test_a_vector_of_another_length_is_refused():
    with pytest.raises(ConfigError, match="needs 5 finite numbers: gravity_x"):
        ParameterSet.parse("paper").to_model(np.zeros(3))


def test_a_search_begins_at_the_robots_own_motors():
    motors = Motors(
        damping=np.full(7, 3.0), armature=np.arange(1, 8) / 10, coulomb=np.full(7, 0.4)
    )
    robot = replace(iiwa14(), motors=motors)
    text = "damping_2,armature,coulomb=0:1,armature_3=0.2:0.9:0.5"
    with pytest.raises(ConfigError):
        ParameterSet.parse(text)  # armature is there twice
    names = ParameterSet.parse("damping_2,armature,coulomb=0:1").of_robot(robot)
    assert [p.start for p in names.parameters] == pytest.approx([3.0, 0.4, 0.4])
    assert [p.high for p in names.parameters] == pytest.approx([6.0, 0.8, 1.0])
    own = ParameterSet.parse("armature_3=0.2:0.9:0.5").of_robot(robot)
    assert own.parameters[0].start == 0.5
    model = own.to_model(np.array([0.5]))
    assert model.damping == (3.0,) * 7  # not identified: as the robot's
    assert model.armature == (0.1, 0.2, 0.5, 0.4, 0.5, 0.6, 0.7)
    assert own.nominal().coulomb == (0.4,) * 7


def test_the_iiwas_search_is_as_its_parameters_say():
    parameters = ParameterSet.parse("extended")
    assert parameters.of_robot(iiwa14()) == parameters
