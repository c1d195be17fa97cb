"""Rows of runs: store, collect and compare rows."""
