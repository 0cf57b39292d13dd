"""Check of a cabinet against the range for which dovetail's limits are proven."""

from dovetail.cabinet.config import CabinetConfig
from dovetail.cabinet.faults import FaultConfig
from dovetail.control.period import FRI_PERIODS
from dovetail.control.proven import DECLARED
from dovetail.plants.twin import Twin


def find_unproven(
    config: CabinetConfig, faults: FaultConfig, twin: Twin | None
) -> list[str]:
    """Say what is outside the proven table: value, range and what to do.

    Args:
        config: The cabinet's settings.
        faults: Its faults, whose delay and jitter are the wire's.
        twin: Which arm it moves; None is one that is as the model says.
    """
    said = {} if twin is None else twin.unproven()
    said.pop("command_delay", None)  # told below, with the wire's
    found = list(said.values())
    slot = config.period_ms * config.receive_multiplier
    if slot not in [round(1e3 * period) for period in FRI_PERIODS]:
        found.append(
            f"period is {slot} ms between two commands; dovetail's limits are proven "
            "for 1, 2 and 5 ms (send period times receive multiplier): give one of "
            "these, or use another client than dovetail's"
        )
    link = faults
    ways = 2 if link.direction == "both" else 1
    wire = ways * (link.delay + link.jitter)
    command_delay = 0.0 if twin is None else twin.command_delay
    longest = DECLARED["delay"]
    if command_delay + wire > longest + 1e-9:
        found.append(
            f"delay is {1e3 * command_delay:g} ms of the twin and {1e3 * wire:g} ms of "
            f"the faults; dovetail's limits are proven for 0 to {1e3 * longest:g} "
            "ms in all: lower command_delay in the twin's file or the faults' delay, "
            "or declare the delay to the client (--delay) and take what it does for a "
            "trial"
        )
    return found
