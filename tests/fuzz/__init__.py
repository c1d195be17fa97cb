"""Readers get files that no program wrote: mutated at random."""
