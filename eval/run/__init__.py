"""From a task and a method to one row: the timed call, warm-up, provenance, and the record of a sweep."""
