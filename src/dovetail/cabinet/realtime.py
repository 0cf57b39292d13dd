"""Real-time priority for this process, where it is permitted."""

import ctypes
import os

_LOCK_CURRENT_AND_FUTURE = 1 | 2  # MCL_CURRENT | MCL_FUTURE


def request_realtime(priority: int = 80) -> str:
    """Ask for SCHED_FIFO and locked memory; threads started later inherit both.

    Args:
        priority: 1 to 99.

    Returns:
        What was given, or why it was not and what to do.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, OSError) as error:
        return (
            f"no real-time priority: {error}; goes on without. Allow it with "
            "`ulimit -r 99` or the capability CAP_SYS_NICE"
        )
    given = f"real-time priority {priority} (SCHED_FIFO)"
    if ctypes.CDLL(None).mlockall(_LOCK_CURRENT_AND_FUTURE) != 0:
        return f"{given}; memory not locked: allow it with `ulimit -l unlimited`"
    return f"{given}, memory locked"
