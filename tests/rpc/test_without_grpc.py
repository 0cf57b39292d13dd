"""gRPC is an extra: nobody pays for it who does not use it."""

import subprocess
import sys

import pytest

from dovetail.errors import install_command

ADDRESS = "grpc://127.0.0.1:9"


def run(script):
    return subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60
    )


def test_the_arm_is_known_without_loading_grpc():
    script = "import dovetail.arms.remote_arm, sys; sys.exit('grpc' in sys.modules)"
    assert run(script).returncode == 0


@pytest.mark.parametrize(
    "use",
    [
        "from dovetail.arms.remote_arm import GrpcAddress, RemoteArm\n"
        f"RemoteArm(GrpcAddress.parse({ADDRESS!r}), None)",
        "from dovetail.cli import run\nsys.exit(run(['serve', '--debug']))",
    ],
)
def test_without_grpc_the_extra_is_named(use):
    result = run(f"import sys\nsys.modules['grpc'] = None\n{use}")
    assert result.returncode == 1
    assert install_command("rpc") in result.stderr
    assert "MissingDependencyError" in result.stderr
