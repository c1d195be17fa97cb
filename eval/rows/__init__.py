"""Rows of runs: store, collect and compare rows, and check rows against bands."""
