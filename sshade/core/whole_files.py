"""Writing files so that they appear whole or not at all."""

from __future__ import annotations

import os
import platform
import re
import stat
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any

from sshade.core.errors import InputError, reason

#: Numbers the writes of this process, so that two threads never share a temporary name.
_WRITES = count()


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`; rename it to `path` on success.

    On any error, interrupts included, the temporary file is removed and an existing file at `path`
    stays. The temporary name keeps the suffix, from which many writers take the format. It is unique
    to this call: of several writers of one path, the last to finish wins. Temporary files that killed
    processes of this machine left for `path` are removed as well.

    A symbolic link is followed: the file that it names is replaced in its own folder, and the link stays.
    The new file has the permissions of the old one. A hard link to the old file
    keeps the old contents.

    Raises
    ------
    InputError
        When the file cannot be written: the disk is full, the folder is missing or read-only, or the path is
        a device, a pipe or a loop of links.
    """
    name = Path(path)
    temporary = None
    try:
        path, old = _target(name)
        _remove_leftovers(path, name.suffix)
        beginning, end = _temporary_affixes(path, name.suffix)
        temporary = path.with_name(f"{beginning}{os.getpid()}-{next(_WRITES)}{end}")
        if old is not None:  # nobody who may not read the old file may read the new one, from the beginning
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
        yield temporary
        if old is not None:
            temporary.chmod(stat.S_IMODE(old.st_mode))
        os.replace(temporary, path)
    except BaseException as error:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise InputError(f"{name}: cannot be written ({reason(error)})") from error
        raise


def _target(path: Path) -> tuple[Path, os.stat_result | None]:
    """Return the path without links, and the state of the file there, or None.

    Raises
    ------
    InputError
        When the path is a device, a pipe or another special file, which a file must not replace.
    OSError
        On a loop of links, or where the path cannot be looked up.
    """
    try:
        old = path.stat()
    except FileNotFoundError:
        return Path(os.path.realpath(path)), None
    if not stat.S_ISREG(old.st_mode) and not stat.S_ISDIR(old.st_mode):
        raise InputError(f"{path}: is a device or a pipe, which cannot be written; give the name of a file")
    return Path(os.path.realpath(path)), old


def _temporary_affixes(path: Path, suffix: str) -> tuple[str, str]:
    """Return the beginning and the end of the temporary names for a path on this machine."""
    host = re.sub(r"[^A-Za-z0-9]", "_", platform.node())[:40]
    # The beginning of a long name, so that the temporary name fits wherever the name does.
    return f".{path.stem[:40]}.{host}-", f".partial{suffix}"


def _remove_leftovers(path: Path, suffix: str) -> None:
    """Remove temporary files for `path` that belong to processes of this machine that have ended."""
    import psutil  # here, so that `import sshade` does not load it

    beginning, end = _temporary_affixes(path, suffix)
    with suppress(OSError):
        for name in os.listdir(path.parent):
            if name.startswith(beginning) and name.endswith(end):
                process, _, _ = name[len(beginning) : -len(end)].partition("-")
                if process.isdecimal() and not psutil.pid_exists(int(process)):
                    (path.parent / name).unlink(missing_ok=True)


@contextmanager
def naming(place: object) -> Iterator[None]:
    """Prefix messages of InputErrors with a place, such as the file that is being read."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}") from error


#: Errors of code that takes arrays of a damaged file for complete.
INCOMPLETE = KeyError, IndexError, TypeError, ValueError


@contextmanager
def expecting(
    what: str, path: str | os.PathLike[str], *, errors: tuple[type[Exception], ...] = (Exception,)
) -> Iterator[None]:
    """Report failures to read a damaged file in one sentence: it is not `what`.

    Raises
    ------
    InputError
        On `errors` but MemoryError. The message of an InputError stays.
    """
    try:
        yield
    except (InputError, MemoryError):
        raise
    except errors as error:  # readers of damaged files fail in many ways
        raise _not_expected(what, path, error) from error


def read_npz(path: str | os.PathLike[str], *names: str, what: str) -> dict[str, Any]:
    """Return the named arrays of a .npz file, or all arrays; raise InputError if the file is not `what`."""
    # here, so that commands print their help without them
    from zipfile import is_zipfile

    import numpy as np

    try:
        with open(path, "rb") as file:
            if not is_zipfile(file):  # NumPy would advise to load it as a pickle
                raise ValueError("it is no .npz file, or ends too early")
            file.seek(0)
            with np.load(file, allow_pickle=False) as data:
                return {name: data[name] for name in names or data.files}
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    # Also a MemoryError, because the header of a damaged array may announce any size.
    except Exception as error:
        raise _not_expected(what, path, error) from error


def _not_expected(what: str, path: str | os.PathLike[str], error: Exception) -> InputError:
    why = " ".join(str(reason(error) if isinstance(error, OSError) else error).split())
    if isinstance(error, KeyError) and " " not in why:
        why = f"it has no {why}"
    elif isinstance(error, AttributeError | TypeError | IndexError):  # their texts are about the code
        missing = isinstance(error, IndexError)
        why = "one of its entries is missing" if missing else "an entry has a wrong type"
    return InputError(f"{path}: not {what} ({why})")


def check_output(
    path: str | os.PathLike[str],
    suffixes: Collection[str],
    *,
    inputs: Iterable[str | os.PathLike[str] | None] = (),
    overwrite: bool | None = False,
) -> None:
    """Raise InputError unless `path` has a known suffix and a file can be written there.

    Commands call this before long computations.

    Parameters
    ----------
    path : path
    suffixes : collection of str
    inputs : iterable of path, optional
        Files that the command reads. The output must not be the same file, under any name.
    overwrite : bool, optional
        Allow the output to be an input. None where --overwrite would not allow it either.
    """
    path = Path(path)
    check_suffix(path, suffixes)
    for given in inputs:
        if given is not None and not overwrite and is_same_file(path, given):
            advice = "" if overwrite is None else ", or pass --overwrite to replace the input"
            raise InputError(f"{path}: is the input {given}; give another name{advice}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist")
    try:
        target, _ = _target(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({reason(error)})") from error
    if not target.parent.is_dir():
        raise InputError(f"{path}: the folder {target.parent} does not exist")
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")
    if not os.access(target.parent, os.W_OK):
        raise InputError(f"{path}: the folder {target.parent} is not writable")


def is_same_file(path: str | os.PathLike[str], other: str | os.PathLike[str]) -> bool:
    """Whether two paths are one file, also through links and on file systems that ignore case."""
    try:
        return os.path.samefile(path, other)
    except OSError:
        return False


#: Formats of scenes that no library here reads, and that Blender converts.
SCENES = (".fbx", ".blend", ".usd", ".usda", ".usdc", ".usdz", ".abc")


def check_suffix(path: Path, suffixes: Collection[str], *, listing: str = "") -> None:
    """Raise InputError unless `path` ends with a known suffix; case does not matter.

    Messages list the suffixes, or `listing`.
    """
    suffix = path.suffix.lower()
    if suffix in suffixes:
        return
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")
    known = listing or ", ".join(suffixes)
    if not suffix:
        raise InputError(f"{path}: its name has no ending, which says the format; use {known}")
    way = f"; Blender converts {suffix} from and to .glb" if suffix in SCENES else ""
    raise InputError(f"{path}: unknown format {path.suffix!r}; use {known}{way}")
