"""Flood a cabinet's UDP port with broken datagrams while a client drives the arm.

    python benchmarks/fuzz_cabinet.py [--count 1000000] [--from stranger|client]

A stranger's datagrams must change nothing at all. Datagrams with the client's own
address are read, so that among millions some are valid commands: there the cabinet must
neither fail nor hang, and serve the client again afterwards.
"""

import argparse
import multiprocessing
import random
import socket
import time

from cabinet_rate import HOLE, Q_START, answer

from dovetail import _core
from dovetail.cabinet.cabinet import Cabinet
from dovetail.cabinet.config import CabinetConfig, Endpoint
from dovetail.envs.registered import find_cell
from dovetail.plants.mujoco_plant import MujocoPlant

_BATCH = 20000


def corpus(version: str) -> list[bytes]:
    """Return good commands of every kind."""
    full, bare = _core.FriCommand(), _core.FriCommand()
    full.q = full.tau = [0.1 * i for i in range(7)]
    full.wrench = [0.0] * 6
    full.io = [_core.FriIo("FRI.Out", 1, 1, digital=5)]
    full.transformations = [_core.FriTransformation("tool", [0.0] * 7, (1, 2))]
    return [c.encode(_core.fri_version(version)) for c in (full, bare)]


def mutated(rng: random.Random, seeds: list[bytes]) -> bytes:
    """Return random bytes, or a good command with bytes changed, cut or added."""
    if rng.random() < 0.2:
        return rng.randbytes(rng.randrange(300))
    data = bytearray(rng.choice(seeds))
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(data) + 1)
        what = rng.randrange(3)
        if what == 0 and at < len(data):
            data[at] = rng.randrange(256)
        elif what == 1:
            del data[at : at + rng.randint(1, 20)]
        else:
            data[at:at] = rng.randbytes(rng.randint(1, 10))
    return bytes(data)


def flood(
    link: socket.socket, target: tuple[str, int], count: int, seeds: list[bytes]
) -> None:
    """Send so many datagrams; a fresh batch is mutated each time it is used up."""
    rng = random.Random(1)
    sent = 0
    while sent < count:
        batch = [mutated(rng, seeds) for _ in range(_BATCH)]
        for _ in range(10):
            for data in batch:
                link.sendto(data, target)
            sent += _BATCH
            if sent >= count:
                return


def main() -> None:
    """Flood, then say what the cabinet counted and whether it still drives the arm."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--from", dest="sender", default="stranger")
    options = parser.parse_args()
    _, there = multiprocessing.Pipe()
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", 0))
    port = link.getsockname()[1]
    client = multiprocessing.Process(target=answer, args=(there, link), daemon=True)
    client.start()
    if options.sender == "stranger":
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    plant = MujocoPlant(find_cell())
    plant.reset(Q_START, HOLE)
    config = CabinetConfig(
        client=Endpoint("127.0.0.1", port),
        bind=Endpoint("127.0.0.1", 0),
        control=None,
        clock="lockstep",
        restart_delay=0.05,
    )
    with Cabinet(plant, config) as cabinet:
        wait_for_motion(cabinet)
        before = cabinet.status()
        start = time.perf_counter()
        sender = multiprocessing.Process(
            target=flood,
            args=(link, tuple(cabinet.address), options.count, corpus("1.15")),
        )
        sender.start()
        link.close()
        sender.join()
        wall = time.perf_counter() - start
        wait_for_motion(cabinet)
        after = cabinet.status()
    counts, earlier = after["counts"], before["counts"]
    names = ("sent", "missed", "foreign", "undecodable", "late", "ahead", "stops")
    changes = {n: counts.get(n, 0) - earlier.get(n, 0) for n in names}
    print(f"{options.count} datagrams from the {options.sender} in {wall:.0f} s")
    print(f"cabinet: {after['state']}, motion {before['motion']} -> {after['motion']}")
    print(f"counted meanwhile: {changes}")


def wait_for_motion(cabinet: Cabinet) -> None:
    """Wait until the arm is driven."""
    end = time.monotonic() + 120.0
    while cabinet.status().get("state") != "COMMANDING_ACTIVE":
        if time.monotonic() > end or not cabinet.is_running:
            raise SystemExit(f"no motion: {cabinet.status()}")
        time.sleep(0.01)


if __name__ == "__main__":
    main()
