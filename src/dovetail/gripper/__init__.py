"""The Weiss / Schunk WSG 50 gripper: its driver, and a simulated one."""
