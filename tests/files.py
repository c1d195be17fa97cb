"""The files of a folder."""

from pathlib import Path


def contents(folder: str | Path = ".") -> dict[str, bytes]:
    """Return the content of every file below a folder, hidden files included, by its path in the folder."""
    paths = sorted(path for path in Path(folder).rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}
