"""The benchmark: metrics, one run to one row, tables and figures from rows.

The command is ``sshade-eval``: :mod:`eval.main`.
"""
