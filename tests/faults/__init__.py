"""Builds and sweeps that are killed, run twice at once, or out of memory."""
