"""Clip a component on a rail."""
