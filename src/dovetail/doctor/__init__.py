"""Checks of the installation, of an arm before it is trusted, and of a camera."""
