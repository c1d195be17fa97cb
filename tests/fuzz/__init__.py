"""Readers on files that nobody wrote: ``python -m tests.fuzz TARGET --executions N``."""
