"""Insertion of a part that a file describes into its fixture."""

IMPLIED_BY = "part"
"""The option that chooses this task where no environment is named."""
