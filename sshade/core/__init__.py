"""Errors, progress, threads, kernels and the console: all packages use them, and they know no geometry."""
