"""Rotations obey the group's axioms, whatever their representation."""

import itertools

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.poses import (
    matrix_from_quat,
    quat_about_z,
    quat_conjugate,
    quat_from_matrix,
    quat_multiply,
    quat_normalized,
    rotation_error,
    swing_twist,
)

TOLERANCE = 1e-12  # rad


def random_quats(rng, count):
    return [quat_normalized(quat) for quat in rng.normal(size=(count, 4))]


def test_matrix_and_quaternion_convert_both_ways(rng):
    half_turns = [np.array(q, dtype=float) for q in np.eye(4)]
    for quat in random_quats(rng, 500) + half_turns:
        R = matrix_from_quat(quat)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=TOLERANCE)
        assert np.linalg.det(R) == pytest.approx(1.0)
        back = quat_from_matrix(R)
        assert back[0] >= 0.0
        assert min(np.abs(back - quat).max(), np.abs(back + quat).max()) < 1e-9


def test_conversion_of_a_matrix_is_accurate_near_half_turns(rng):
    for axis in rng.normal(size=(200, 3)):
        axis /= np.linalg.norm(axis)
        half = (np.pi - rng.uniform(0, 1e-5)) / 2
        quat = np.concatenate([[np.cos(half)], np.sin(half) * axis])
        R = matrix_from_quat(quat)
        np.testing.assert_allclose(
            matrix_from_quat(quat_from_matrix(R)), R, atol=TOLERANCE
        )


def test_product_of_quaternions_is_product_of_matrices(rng):
    quats = random_quats(rng, 200)
    for left, right in itertools.pairwise(quats):
        product = quat_multiply(left, right)
        assert product[0] >= 0.0
        np.testing.assert_allclose(
            matrix_from_quat(product),
            matrix_from_quat(left) @ matrix_from_quat(right),
            atol=TOLERANCE,
        )


def test_conjugate_inverts(rng):
    for quat in random_quats(rng, 100):
        product = quat_multiply(quat, quat_conjugate(quat))
        np.testing.assert_allclose(product, [1, 0, 0, 0], atol=TOLERANCE)


def test_rotation_error_of_a_turn_about_z_is_that_turn(rng):
    for quat in random_quats(rng, 200):
        theta = rng.uniform(-3.1, 3.1)
        turned = quat_multiply(quat_about_z(theta), quat)
        error = rotation_error(turned, quat)
        np.testing.assert_allclose(error, [0, 0, theta], atol=1e-9)
        swing, twist = swing_twist(quat_multiply(turned, quat_conjugate(quat)))
        np.testing.assert_allclose(swing, 0.0, atol=1e-9)
        np.testing.assert_allclose(twist, quat_about_z(theta), atol=1e-9)


def test_rotation_error_ignores_the_sign_of_either_quaternion(rng):
    quats = random_quats(rng, 100)
    for desired, current in itertools.pairwise(quats):
        error = rotation_error(desired, current)
        assert np.linalg.norm(error) <= np.pi + TOLERANCE
        for signs in ((-1, 1), (1, -1), (-1, -1)):
            other = rotation_error(signs[0] * desired, signs[1] * current)
            np.testing.assert_allclose(other, error, atol=1e-9)


def test_rotation_error_is_exact_for_tiny_angles():
    for angle in (0.0, 1e-15, 1e-10, 1e-6):
        quat = np.array([np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0])
        error = rotation_error(quat, np.array([1.0, 0.0, 0.0, 0.0]))
        np.testing.assert_allclose(error, [angle, 0, 0], rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("quat", [[0, 0, 0, 0], [np.nan, 0, 0, 1], [np.inf, 0, 0, 0]])
def test_a_quaternion_without_direction_is_refused(quat):
    with pytest.raises(ConfigError, match="is not a rotation"):
        quat_normalized(np.array(quat, dtype=float))
