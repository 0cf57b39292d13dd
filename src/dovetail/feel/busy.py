"""Check for an overloaded machine, whose answers come late."""

import os


def busy_words() -> str:
    """Return a warning and a remedy if the machine is overloaded, else empty text."""
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load <= cores:
        return ""
    return (
        f"This machine is busy (load {load:.1f} on {cores} cores), so that answers "
        "come late: end what else runs here; a simulated cabinet waits for it with "
        "clock=lockstep"
    )
