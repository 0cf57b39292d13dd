"""The controller's settings, its builder and its readable NumPy reference."""

from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import TaskSpec

__all__ = ["LimitConfig", "OscConfig", "TaskSpec", "make_controller"]
