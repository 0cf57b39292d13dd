"""Diagnosis of an arm by small torques of its own that push it."""
