"""Builds and sweeps that are killed or run twice at once."""
