"""Meshes of two parts that go together, turned into sections that an engine builds."""
