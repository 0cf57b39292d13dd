"""OpenCV, imported when a picture is looked at, and in one place."""

from types import ModuleType
from typing import Any

from dovetail.errors import MissingDependencyError, install_command


def opencv() -> Any:
    """Return the module cv2.

    Raises:
        MissingDependencyError: It is not there, or is 5.0, whose wheels lack functions.
    """
    try:
        import cv2
    except ImportError as error:
        raise MissingDependencyError(
            f"a camera needs OpenCV: {install_command('camera')}"
        ) from error
    module: ModuleType = cv2
    version = str(vars(module)["__version__"])
    if not version.startswith("4."):
        raise MissingDependencyError(
            f"OpenCV {version} is installed; 5.0 lacks functions that a camera needs: "
            f"{install_command('camera')}"
        )
    return module
