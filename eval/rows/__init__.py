"""Rows of runs: stored, gathered, compared, measured again, held against bands."""
