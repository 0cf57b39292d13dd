"""Identification: make the simulation move as the arm does (Kaspar et al. 2020)."""
