"""From rows to tables, charts, pictures and the report."""
