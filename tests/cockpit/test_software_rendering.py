"""What a browser that draws by the processor gets: less to draw, the same to see."""

import mujoco
import numpy as np
import pytest

from dovetail.cockpit.scene import triangles
from dovetail.cockpit.session import Session
from dovetail.cockpit.software_rendering import fewer_triangles
from dovetail.view.cell_model import LAST_DRAWN, cell_spec
from extras import need

from .conftest import from_benchmarks

need("fast_simplification")
trimesh = need("trimesh")
driven = from_benchmarks("cockpit_browser")
button, wait_for = driven.button, driven.wait_for


def test_a_sphere_of_fewer_triangles_is_nearly_the_same():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.1)
    vertices, faces = fewer_triangles(ball.vertices, ball.faces)
    assert 200 <= len(faces) < 0.25 * len(ball.faces)
    radii = np.linalg.norm(vertices, axis=1)
    assert np.abs(radii - 0.1).max() < 0.001
    less = trimesh.Trimesh(vertices, faces)
    assert less.is_watertight
    assert less.volume == pytest.approx(ball.volume, rel=0.01)


def test_few_triangles_stay_as_they_are():
    box = trimesh.creation.box(extents=(0.1, 0.2, 0.3))
    vertices, faces = fewer_triangles(box.vertices, box.faces)
    assert vertices is box.vertices
    assert faces is box.faces


def test_the_whole_cell_is_few_triangles_and_no_vertex_moves_far(session: Session):
    """Whole it is 20,500, and they took 70 ms a picture."""
    model = cell_spec(session.core.cell).compile()
    drawn = 0
    for geom in np.flatnonzero(model.geom_group <= LAST_DRAWN):
        vertices, faces, _ = triangles(mujoco, model, int(geom))
        drawn += len(faces)
        mesh = model.geom_dataid[geom]
        if mesh < 0:
            continue
        first = model.mesh_vertadr[mesh]
        whole = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        size = np.ptp(whole, axis=0)
        np.testing.assert_allclose(np.ptp(vertices, axis=0), size, atol=0.008)
    assert drawn < 8000


def test_a_browser_without_a_gpu_draws_half_the_pixels_each_way(browser, cockpit):
    drawn = "const c = document.querySelector('canvas[data-engine]');"
    ratio = f"{drawn} return c.width / c.getBoundingClientRect().width"
    wait_for(lambda: abs(browser.execute_script(ratio) - 0.5) < 0.02)


def test_a_page_that_is_loaded_again_draws_as_before(browser, cockpit):
    _, server = cockpit
    browser.refresh()
    wait_for(lambda: button(browser, "STOP") and server.viser.get_clients())
    assert "fixedDpr=0.5" in browser.current_url


def test_an_animation_that_is_called_off_is_not_drawn(browser, cockpit):
    """Also one that waits for its turn."""
    browser.set_script_timeout(10)
    drawn = browser.execute_async_script(
        """
        const done = arguments[0];
        let drawn = 0, ids = [];
        requestAnimationFrame(() => {
          for (let i = 0; i < 20; i++) ids.push(requestAnimationFrame(() => drawn++));
          setTimeout(() => ids.forEach((id) => cancelAnimationFrame(id)), 8);
          setTimeout(() => done(drawn), 500);
        });
        """
    )
    assert drawn in (0, 20)  # all before they were called off, or none
