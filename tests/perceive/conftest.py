"""What tests with pictures need."""

import pytest

from dovetail.errors import MissingDependencyError
from dovetail.view.gl_context import open_context
from extras import need

need("cv2")


@pytest.fixture(scope="session")
def opengl():
    """Skips where nothing draws without a screen; the reason names the packages."""
    try:
        open_context(16, 16).free()
    except MissingDependencyError as error:
        pytest.skip(str(error))
