"""The part of three.js that pages of this project draw with: see ``three.entry.js`` and NOTICE."""

from importlib.resources import files


def source() -> str:
    """The script, which defines ``THREE``."""
    return files(__name__).joinpath("three.min.js").read_text(encoding="utf-8")
