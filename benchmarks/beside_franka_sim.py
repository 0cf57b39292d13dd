"""Run a command beside franka-sim, whose physics keep step with its states.

`make rehearse-franka` makes the environment of franka-sim. The command is meant for
`--arm franka://127.0.0.1`, where it listens. FCI's limits of a motion are enforced, and
with `--enforce` that commands arrive, too.
"""

import argparse
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYTHON = ROOT / ".venv/franka-sim/bin/python"
PORT = 1337
HOST = "127.0.0.1"
BEGINS, TICK = 60.0, 0.2  # s until it listens, and between two looks
SERVER = Path(__file__).with_name("franka_in_step.py")


@contextmanager
def franka_in_step(
    python: Path = PYTHON,
    *,
    hangs: float = 0.0,
    enforce: bool = False,
    under: str = "",
    host: str = HOST,
    options: Sequence[str] = (),
) -> Iterator[None]:
    """Run it until the block ends.

    Args:
        python: Of the environment that has franka-sim.
        hangs: Mass at its hand that it does not compensate [kg].
        enforce: End a motion whose commands come late.
        under: Command that starts it, such as `chrt -f 20`.
        host: Address where it will listen, of a network namespace that `under` enters.
        options: More of `franka_in_step.py`.
    """
    if is_listening(host):
        sys.exit(f"port {PORT}, the only one of FCI, is taken: end what listens there")
    constraints = f"--{'' if enforce else 'no-'}enforce-comm-constraints"
    command = [*under.split(), str(python), str(SERVER), "--hangs", str(hangs)]
    command += ["--physics", "mujoco", "--no-gripper", "--enforce-motion-limits"]
    with tempfile.TemporaryFile("w+") as said:
        server = subprocess.Popen(
            [*command, constraints, *options], stdout=said, stderr=subprocess.STDOUT
        )
        try:
            if not _wait_for(server, host):
                said.seek(0)
                sys.exit(f"franka-sim does not listen at {host}:{PORT}: {said.read()}")
            yield
        finally:
            server.terminate()
            server.wait()


def _wait_for(server: subprocess.Popen[bytes], host: str) -> bool:
    """Wait until it listens; return False where it has ended, or takes too long."""
    for _ in range(round(BEGINS / TICK)):
        if server.poll() is not None:
            return False
        if is_listening(host):
            return True
        time.sleep(TICK)
    return False


def is_listening(host: str = HOST) -> bool:
    """Return whether something listens at the port of FCI."""
    with socket.socket() as probe:
        return probe.connect_ex((host, PORT)) == 0


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--python", type=Path, default=PYTHON, help="of franka-sim")
    parser.add_argument("--hangs", type=float, default=0.0, help="at its hand [kg]")
    parser.add_argument("--enforce", action="store_true", help="commands must arrive")
    parser.add_argument("--under", default="", help="starts it, such as 'chrt -f 20'")
    parser.add_argument("command", nargs=argparse.REMAINDER, help="to run beside it")
    args = parser.parse_args()
    given = args.python.absolute()
    with franka_in_step(
        given, hangs=args.hangs, enforce=args.enforce, under=args.under
    ):
        sys.exit(subprocess.call(args.command))


if __name__ == "__main__":
    main()
