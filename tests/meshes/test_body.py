"""Mass and inertia of bodies whose formula is known."""

import numpy as np
import pytest

from extras import need

trimesh = need("trimesh")

from dovetail.meshes.body import inertia_of  # noqa: E402


def test_a_box_beside_the_origin_has_the_formula_s_inertia():
    sides, at = np.array([0.02, 0.03, 0.05]), np.array([0.1, -0.2, 0.3])
    box = trimesh.creation.box(sides)
    box.apply_translation(at)
    found = inertia_of(box, 2700.0)
    mass = 2700.0 * np.prod(sides)
    x, y, z = sides**2
    assert found.mass == pytest.approx(mass)
    assert found.centre == pytest.approx(at)
    exact = mass / 12.0 * np.diag([y + z, x + z, x + y])
    assert found.inertia == pytest.approx(exact, abs=1e-9 * mass)
