"""ARAP with smooth rotations."""
