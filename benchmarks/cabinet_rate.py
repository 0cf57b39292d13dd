"""Measure how fast a lockstep cabinet runs against a client in another process.

The client mirrors and answers with the codec's binding; the figure is send periods per
second, and how many times faster than real time that is.

    python benchmarks/cabinet_rate.py [--plant light|mujoco|medium] [--seconds 3]
"""

import argparse
import multiprocessing
import socket
import time
from multiprocessing.connection import Connection

import numpy as np

from dovetail import _core
from dovetail.cabinet.cabinet import Cabinet
from dovetail.cabinet.config import CabinetConfig, Endpoint
from dovetail.envs.registered import find_cell
from dovetail.plants.mujoco_plant import MujocoPlant
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z

Q_START = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.5])
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))


def answer(port_pipe: Connection, link: socket.socket | None = None) -> None:
    """Answer every message: mirror, then hold with a spring in each joint."""
    version = _core.fri_version("1.15")
    if link is None:
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        link.bind(("127.0.0.1", 0))
        port_pipe.send(link.getsockname()[1])
    command = _core.FriCommand()
    sequence = 0
    while True:
        data, cabinet = link.recvfrom(2000)
        message = _core.FriMonitoring.decode(version, data)
        assert message.state is not None
        state = int(message.state)
        if state == 0:
            return
        if state >= 3:
            command.q = message.ipo_q if state == 3 else message.q_measured
            command.tau = 50.0 * (np.array(message.ipo_q) - message.q_measured)
        command.sequence, command.reflected = sequence, message.sequence
        sequence += 1
        link.sendto(command.encode(version), cabinet)


def main() -> None:
    """Print the rate while COMMANDING_ACTIVE."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plant", default="medium")
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--period", type=float, default=0.005)
    options = parser.parse_args()
    here, there = multiprocessing.Pipe()
    client = multiprocessing.Process(target=answer, args=(there,), daemon=True)
    client.start()
    config = CabinetConfig(
        clock="lockstep",
        period=options.period,
        client=Endpoint("127.0.0.1", here.recv()),
        bind=Endpoint("127.0.0.1", 0),
        control=None,
    )
    cell = find_cell()
    if options.plant == "mujoco":
        plant = MujocoPlant(cell)
    else:
        plant = make_twin(load_twin(options.plant), cell)
    plant.reset(Q_START, HOLE)
    with Cabinet(plant, config) as cabinet:
        while cabinet.request({"do": "status"})["state"] != "COMMANDING_ACTIVE":
            time.sleep(0.01)
        first = cabinet.request({"do": "status"})
        start, cpu = time.perf_counter(), time.process_time()
        time.sleep(options.seconds)
        last = cabinet.request({"do": "status"})
        wall = time.perf_counter() - start
        cpu = time.process_time() - cpu
    slots = last["sequence"] - first["sequence"]
    rate = slots / wall
    print(
        f"{options.plant}: {rate:.0f} periods/s, {1e6 / rate:.0f} us each (cabinet's "
        f"CPU time {1e6 * cpu / slots:.0f} us), "
        f"{rate * options.period:.1f} x real time; state {last['state']}"
    )


if __name__ == "__main__":
    main()
