"""Seeing the fixture: camera, printed board, detection, calibration."""
