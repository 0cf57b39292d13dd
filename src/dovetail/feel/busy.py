"""Whether this machine has more to do than it can: answers then come late."""

import os


def busy_words() -> str:
    """Say so, and what to do; empty where the machine has time."""
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load <= cores:
        return ""
    return (
        f"This machine is busy (load {load:.1f} on {cores} cores), so that answers "
        "come late: end what else runs here; a simulated cabinet waits for it with "
        "clock=lockstep"
    )
