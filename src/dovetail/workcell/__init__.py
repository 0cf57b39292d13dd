"""Surroundings of an arm: its tool, the part it holds, a fixture, a table, walls."""
