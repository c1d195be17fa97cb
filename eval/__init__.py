"""The benchmark: metrics, one run to one row, tables and figures from rows.

``python -m eval`` runs methods; ``eval.collect``, ``eval.tables``, ``eval.figures`` and
``eval.check`` work on what it left.
"""
