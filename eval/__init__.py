"""The benchmark: metrics, one run to one row, tables and figures from rows.

``python -m eval`` runs methods; ``eval.rows.collect``, ``eval.publish.tables``, ``eval.publish.figures`` and
``eval.rows.bands`` work on what it left.
"""
