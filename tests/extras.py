"""What not every set-up has: a test that needs it is skipped with the way to get it."""

import os

import pytest

from dovetail.errors import install_command

EXTRA_OF = {
    "cmaes": "identify",
    "plotly": "identify",
    "cv2": "camera",
    "fast_simplification": "view",
    "manifold3d": "test",
    "grpc": "rpc",
    "grpc_tools": "test",
    "pinocchio": "test",
    "pyarrow": "log",
    "pyarrow.parquet": "log",
    "pybullet": "bullet",
    "pybullet_data": "bullet",
    "pydrake": "drake",
    "pygame": "film",
    "qpsolvers": "test",
    "ray": "cluster",
    "sbx": "learn",
    "selenium": "test",
    "shapely": "parts",
    "snakemake": "reproduce",
    "trimesh": "parts",
    "viser": "view",
}
"""The extra of pyproject.toml that installs a module."""


def need(module):
    """Return the module; skip the test where it is not installed."""
    install = install_command(EXTRA_OF[module])
    return pytest.importorskip(module, reason=f"needs {module}: {install}")


NEEDS_FRANKA_SIM = "needs franka-sim, in an environment of its own: make test-franka"


def need_franka_sim_alone():
    """Skip the test where others run beside it: FCI has one port, and a deadline."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        pytest.skip("FCI has one port: make test-franka runs these one after the other")
