"""The store of the machine code of kernels.

The package keeps the machine code in a store of its own, so that the caches of other packages in the process
stay as they are. A wheel ships the store filled for a common level of the processor family. In a checkout,
``make`` fills the store through :mod:`tools.compile_kernels`.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import sys
import threading
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from llvmlite import binding as llvm
from numba import types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numba.misc.appdirs import AppDirs

#: Kernels that came with the package, or that a checkout has compiled.
SHIPPED = Path(__file__).parents[1] / "compiled"
#: Level that a machine's processors have in common, and processor features that tell whether it can be used.
LEVELS: dict[str, tuple[str, tuple[str, ...]]] = {
    "x86_64": ("x86-64-v3", ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")),
    "arm64": ("apple-m1", ("fullfp16",)),
}
#: Length in bytes of the hashes in a file of the store.
HASH = 32


class Store(NullCache):
    """The machine code of a kernel on disk, in numba's protocol of caches.

    A file holds one signature for one Python, numba and processor. It begins with a line that names the
    kernel and its types of arguments. The hashes of the source and of the machine code follow. A file that is
    damaged, or made from another source, is ignored and replaced.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.name = f"{function.__module__} {function.__qualname__}"
        self.source = Path(function.__code__.co_filename)

    def path(self, sig: Any, target_context: Any) -> Path:
        """Return the file of a signature for the processor of this process."""
        return folders()[0] / self._file(sig, target_context.codegen().magic_tuple())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        for folder in folders():
            for target in (portable_target(), target_context.codegen().magic_tuple()):
                code = self._read(folder / self._file(sig, target)) if target else None
                # Compiled kernels have the trust of the package that they come with.
                if code is not None:
                    return CompileResult._rebuild(target_context, *pickle.loads(code))  # noqa: S301
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        if data.library.has_dynamic_globals:
            raise RuntimeError(f"{self.name}: machine code with an address of this process cannot be kept")
        code = dumps(data._reduce())
        line = f"{self.name} {describe(sig)}\n".encode()
        content = line + _hash_of_file(self.source) + hashlib.sha256(code).digest() + code
        failures = []
        for folder in folders():
            try:
                _replace(folder / self._file(sig, data.codegen.magic_tuple()), content)
                return
            except OSError as error:
                failures.append(f"{folder}: {error.strerror}")
        _warn_once("compiled kernels cannot be kept, so the next call compiles again; " + "; ".join(failures))

    def _file(self, sig: Any, target: tuple[str, ...]) -> str:
        """Return the name of the file for a signature and a processor."""
        key = "\n".join([str(sig), sys.implementation.cache_tag, numba.__version__, *target])
        return f"{self.name.replace(' ', '.')}-{hashlib.sha256(key.encode()).hexdigest()[:24]}"

    def _read(self, path: Path) -> bytes | None:
        """Return the machine code in a file, None if it is absent, damaged or made from another source."""
        try:
            _, _, content = path.read_bytes().partition(b"\n")
        except OSError:
            return None
        source, checksum, code = content[:HASH], content[HASH : 2 * HASH], content[2 * HASH :]
        sound = source == _hash_of_file(self.source) and checksum == hashlib.sha256(code).digest()
        return code if sound else None


def folders() -> list[Path]:
    """Return the folders of the store in the order of the search. The first writable folder is filled.

    The variable ``SSHADE_KERNELS`` names a folder that replaces them. ``NUMBA_CACHE_DIR`` replaces the folder
    for caches of the user.
    """
    named = os.environ.get("SSHADE_KERNELS")
    return [Path(named)] if named else [SHIPPED, *_user_folders()]


@cache
def _user_folders() -> list[Path]:
    """Return the user's folder for kernels of this installation; none for a user without a home."""
    parent = os.environ.get("NUMBA_CACHE_DIR")
    if not parent:
        parent = AppDirs("sshade", appauthor=False).user_cache_dir
        if not os.path.isabs(parent):  # an empty XDG_CACHE_HOME, or "~" itself
            return []
    return [Path(parent, hashlib.sha256(str(SHIPPED).encode()).hexdigest()[:16])]


@cache
def portable_target() -> tuple[str, str, str] | None:
    """Return the triple, processor and features of shipped kernels, None if it cannot run them."""
    level, needed = LEVELS.get(platform.machine().lower().replace("amd64", "x86_64"), ("", ()))
    features = llvm.get_host_cpu_features()
    if not level or not all(features.get(name) for name in needed):
        return None
    return llvm.get_process_triple(), level, ""


def describe(signature: tuple[Any, ...]) -> str:
    """Return the types of arguments as a line, such as ``int64 float64:2C ( float64 float64 )``.

    An array is its dtype, its number of dimensions and its layout, with r if it is read only. A tuple is in
    parentheses, after the name of its class.
    """
    words = []
    for kind in signature:
        if isinstance(kind, types.Array):
            words.append(f"{kind.dtype}:{kind.ndim}{kind.layout}{'' if kind.mutable else 'r'}")
        elif isinstance(kind, types.BaseTuple):
            name = kind.instance_class.__name__ if isinstance(kind, types.NamedTuple) else ""
            words.append(f"{name}( {describe(tuple(kind))} )")
        else:
            words.append(str(kind))
    return " ".join(words)


@cache
def _hash_of_file(path: Path) -> bytes:
    """Return the hash of a source file, equal for the line ends of all systems."""
    return hashlib.sha256(path.read_bytes().replace(b"\r\n", b"\n")).digest()


def _replace(path: Path, content: bytes) -> None:
    """Write a whole file, or leave the old one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        temporary.write_bytes(content)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@cache
def _warn_once(message: str) -> None:
    warnings.warn(message, stacklevel=2)
