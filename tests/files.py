"""The files of a folder, and a folder for the time of the tests."""

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

SAMPLES = Path(__file__).parent / "sshade" / "files" / "samples"


def contents(folder: str | Path = ".") -> dict[str, bytes]:
    """Return the content of every file below a folder, hidden files included, by its path in the folder."""
    paths = sorted(path for path in Path(folder).rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@cache
def scratch() -> Path:
    """Return a folder of this process, which is removed when the process ends."""
    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def sample(name: str) -> str:
    """Return the text of a file of ``tests/sshade/files/samples``, with the line ends that it has."""
    return (SAMPLES / name).read_bytes().decode()
