"""Mesh a gear with another that stands beside its shaft."""
