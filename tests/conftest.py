"""Fixtures shared by every test: a seeded generator and the arm with its gripper."""

import numpy as np
import pytest

from dovetail.robot import Payload, Robot, iiwa14


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240917)


@pytest.fixture(scope="session")
def gripper() -> Payload:
    """A 1.2 kg box, 0.18 m long, in front of the flange."""
    return Payload(
        mass=1.2,
        com=np.array([0.005, -0.003, 0.07]),
        inertia=np.diag([0.0036, 0.0037, 0.0014]),
    )


@pytest.fixture(scope="session")
def robot(gripper: Payload) -> Robot:
    """The controller's iiwa 14 with a gripper; the TCP 0.18 m from the flange."""
    return iiwa14().with_tool(gripper, np.array([0.0, 0.0, 0.18]))


@pytest.fixture(scope="session")
def q_home() -> np.ndarray:
    """Tool down above the middle of the walls [rad]."""
    return np.array([0.0, 0.6, 0.0, -1.55, 0.0, 0.99, 0.0])
