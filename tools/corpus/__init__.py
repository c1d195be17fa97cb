"""A corpus of mesh files: real kinds of files, each deformed by every method and checked by other code."""
