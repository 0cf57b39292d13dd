"""The robot's side of FRI: a simulated cabinet over any plant or twin."""
