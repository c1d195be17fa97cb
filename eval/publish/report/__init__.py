"""Results on one page: ``python -m eval.publish.report [ROWS ...]`` writes a self-contained HTML file."""
