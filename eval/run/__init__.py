"""Run a method on a task: warm-up, timed call, version of the code, row, record of a sweep."""
