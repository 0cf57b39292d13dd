"""A renderer for the tests of pictures; without OpenGL they are left out."""

import pytest

from dovetail.envs.registered import find_cell
from dovetail.errors import MissingDependencyError
from dovetail.view.renderer import Renderer


@pytest.fixture(scope="module")
def renderer():
    try:
        renderer = Renderer(find_cell())
    except MissingDependencyError as error:
        pytest.skip(str(error))  # it names the Debian packages
    yield renderer
    renderer.close()
