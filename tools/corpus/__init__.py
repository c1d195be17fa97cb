"""A corpus of mesh files: real kinds of files, each deformed by three methods and checked by other code."""
