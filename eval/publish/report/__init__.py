"""Results on one page: ``sshade-eval report [ROWS ...]`` writes a self-contained HTML file."""
