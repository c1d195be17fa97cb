"""Readers on files that nobody wrote: mutated by chance, and guided by coverage."""
