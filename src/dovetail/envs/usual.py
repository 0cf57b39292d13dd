"""Settings of a task where nothing else is asked for, each in this one place."""

F_SCALE = 4.0
"""f* at action 1 on X Y Z [m/s2]."""
F_SCALE_ANGULAR = 20.0
"""f* at action 1 on A B C [rad/s2]."""
FORCE_DAMPING = 40.0
"""Damping of force axes [1/s]."""
NEAR_SPEED = 0.02
"""Speed limit of the TCP per axis where contact is near [m/s]."""
NEAR_PRESS = 1.5
"""Largest f* towards the hole there [m/s2]."""
NEAR_DISTANCE = 0.01
"""How far above the hole's mouth that begins [m]."""
THETA_RANGE = 0.2
"""Rotation at action 1 on pose axes A B C [rad]."""
POSITION_RANGE = 0.05
"""Displacement at action 1 on pose axes X Y Z [m]."""
