"""FRI's numbers that the cabinet's logic needs (the wire itself is in C++)."""

from enum import IntEnum

MAX_IO = 10
"""Largest number of IO signals in a message."""
MAX_TRANSFORMATIONS = 5
"""Largest number of transformations in a message."""
MAX_NAME = 63
"""Longest name of a signal or transformation [bytes]."""
VERSIONS = ("1.15", "2.5", "2.7")
"""Wire versions; 1.14 and 1.16 speak 1.15."""


class SessionState(IntEnum):
    """State of the FRI session, as in every monitoring message."""

    IDLE = 0
    MONITORING_WAIT = 1
    MONITORING_READY = 2
    COMMANDING_WAIT = 3
    COMMANDING_ACTIVE = 4


class Quality(IntEnum):
    """Connection quality, by the share of replies in time."""

    POOR = 0
    FAIR = 1
    GOOD = 2
    EXCELLENT = 3


class SafetyState(IntEnum):
    """Stop commanded by the safety controller, if any."""

    NORMAL_OPERATION = 0
    STOP_0 = 1
    STOP_1 = 2
    STOP_2 = 3


class DriveState(IntEnum):
    """State of a joint's drive."""

    OFF = 0
    TRANSITIONING = 1
    ACTIVE = 2


class ControlMode(IntEnum):
    """Control law of the arm."""

    POSITION = 0
    CARTESIAN_IMPEDANCE = 1
    JOINT_IMPEDANCE = 2
    NO_CONTROL = 3


class CommandMode(IntEnum):
    """Client command mode: the command that the running overlay expects."""

    NONE = 0
    POSITION = 1
    WRENCH = 2
    TORQUE = 3


class Overlay(IntEnum):
    """Kind of the running motion overlay."""

    NONE = 0
    JOINT = 1
    CARTESIAN = 2


class IoType(IntEnum):
    """Type of an IO signal."""

    BOOLEAN = 0
    DIGITAL = 1
    ANALOG = 2


class IoDirection(IntEnum):
    """Direction of an IO signal: the cabinet writes an input, the client an output."""

    INPUT = 0
    OUTPUT = 1
