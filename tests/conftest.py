"""Fixtures shared by every test: a seeded generator and the arm with its gripper."""

import ctypes
import os
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from dovetail.errors import MissingDependencyError
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot import Payload, Robot
from dovetail.view.gl_context import open_context

# Every training would compile its networks anew, which takes longer than it trains.
# A folder of this run: what a killed training has half written is never read again.
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    _COMPILED = TemporaryDirectory(prefix="dovetail-jax-", ignore_cleanup_errors=True)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = _COMPILED.name
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"


SLOW = Path(__file__).with_name("slow.txt")
"""Names of the slow tests; `tests/list_slow.py` makes it."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--fast", action="store_true", help="leave out the slow tests")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out modules in which every test is slow: they need not be imported."""
    if not config.getoption("--fast") or collection_path.suffix != ".py":
        return None
    module = collection_path.relative_to(config.rootpath).with_suffix("")
    return ".".join(module.parts) in SLOW.read_text().split() or None


def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Leave out the slow tests where `--fast` asks for it."""
    if not config.getoption("--fast"):
        return
    slow = set(SLOW.read_text().split())
    left_out = [item for item in items if _function_of(item) in slow]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if _function_of(item) not in slow]


def _function_of(item: pytest.Item) -> str:
    """Return a test's function as tests.room.module::name."""
    file, _, name = item.nodeid.partition("::")
    module = file.removesuffix(".py").replace("/", ".")
    return f"{module}::{name.partition('[')[0]}"


@pytest.fixture(scope="session")
def opengl() -> None:
    """Skips where nothing draws without a screen; the reason names the packages."""
    try:
        open_context(16, 16).free()
    except MissingDependencyError as error:
        pytest.skip(str(error))


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


@pytest.fixture
def no_privileges() -> Iterator[None]:
    """Runs the test's thread, and those it starts, without root's capabilities."""
    if os.geteuid() != 0:
        yield
        return
    libc = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # version 3, this thread
    before = (ctypes.c_uint32 * 6)()  # twice effective, permitted, inheritable
    assert libc.capget(header, before) == 0
    without = (ctypes.c_uint32 * 6)(*before)
    without[0] = without[3] = 0
    assert libc.capset(header, without) == 0
    yield
    assert libc.capset(header, before) == 0


@pytest.fixture
def forbidden_port(no_privileges: None) -> int:
    """A TCP and UDP port that this process must not open."""
    first = Path("/proc/sys/net/ipv4/ip_unprivileged_port_start")
    if first.exists() and int(first.read_text()) <= 81:
        pytest.skip(f"needs ports that only root may open: echo 1024 > {first}")
    return 81
