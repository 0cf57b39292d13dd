"""Arms behind a simulated cabinet on this machine's loopback."""

import socket
from contextlib import contextmanager

from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.cabinet.cabinet import Cabinet
from dovetail.cabinet.config import CabinetConfig, Endpoint
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.durations import format_ms
from dovetail.settings import names_in

LOOPBACK = "127.0.0.1"


def free_port():
    """A UDP port that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]


def make_cabinet(plant, port, period, **settings):
    """A cabinet over the plant that sends to a port of this machine."""
    config = CabinetConfig(
        period=period,
        client=Endpoint(LOOPBACK, port),
        bind=Endpoint(LOOPBACK, 0),
        control=Endpoint(LOOPBACK, 0),
        **settings,
    )
    return Cabinet(plant, config)


@contextmanager
def lockstep_address(plant, *, period=0.005, **settings):
    """Run a lockstep cabinet over the plant; yields its arm's address."""
    port = free_port()
    with make_cabinet(plant, port, period, clock="lockstep", **settings) as running:
        yield (
            f"fri://{LOOPBACK}:{port}?period={format_ms(period)}&clock=lockstep"
            f"&control={running.control_address}"
        )
    plant.close()


class CabinetArm(FriArm):
    """A FriArm with its own cabinet over a plant, in lockstep unless told otherwise."""

    def __init__(self, plant, osc, limits, task, period, *, cabinet=None, **options):
        self.plant = plant
        self._is_open = True
        options = {"clock": "lockstep", "log_folder": None, **options}
        names = set(names_in(FriAddress))
        where = {name: options.pop(name) for name in names & options.keys()}
        port = where.pop("port", None) or free_port()
        settings = {"clock": where["clock"], **(cabinet or {})}
        self.cabinet = make_cabinet(plant, port, period, **settings)
        where.setdefault("control", str(self.cabinet.control_address))
        spec = TaskSpec.parse(task) if isinstance(task, str) else task
        made_of = ControllerSettings(osc=osc, limits=limits, task=spec, period=period)
        try:
            address = FriAddress(host=LOOPBACK, port=port, **where)
            super().__init__(address, plant.cell.loaded_robot(), made_of, **options)
        except Exception:
            self.cabinet.close()
            raise
        self.cabinet.start()

    def ask(self, do, **what):
        """Ask something of the cabinet."""
        answer = self.cabinet.request({"do": do, **what})
        assert answer["ok"], answer
        return answer

    def close(self):
        if self._is_open:
            self._is_open = False
            super().close()
            self.cabinet.close()
            self.plant.close()
