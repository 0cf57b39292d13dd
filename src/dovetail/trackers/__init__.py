"""Trackers: where the fixture is, as far as one may know; one file for each."""
