"""A small wheel for tests."""

from pathlib import Path
from zipfile import ZipFile


def small_wheel(folder: Path) -> Path:
    """Write a wheel of the package ``sshade_probe``, and return its path."""
    path, info = folder / "sshade_probe-1.0-py3-none-any.whl", "sshade_probe-1.0.dist-info"
    with ZipFile(path, "w") as archive:
        archive.writestr("sshade_probe.py", "")
        archive.writestr(f"{info}/METADATA", "Metadata-Version: 2.1\nName: sshade_probe\nVersion: 1.0\n")
        archive.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        archive.writestr(f"{info}/RECORD", "")
    return path
