"""ARAP on a deformation graph."""
