"""Results on one page: ``python -m eval.report [ROWS ...]`` writes a self-contained HTML file."""
