"""The 3D view of pages: the shapes that it shows, reduced and packed, and its script."""

from importlib.resources import files


def viewer() -> str:
    """Return the script of the view; it needs ``THREE`` of :mod:`sshade.threejs`."""
    return files(__name__).joinpath("viewer.js").read_text(encoding="utf-8")
