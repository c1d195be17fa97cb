"""Scenes in Python: what they give, how often functions are called, and how much memory they take.

A scene is a function of :mod:`tests.record.scenes` that yields names and values. Its record has the values,
then the calls of the functions of the packages, and the peak of the memory that is allocated. Functions that
are called within iterations have many calls, which another processor changes a little.
"""

import gc
import logging
import os
import re
import sys
import threading
import tracemalloc
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import CodeType

import sshade
from eval.pace import on_one_cpu
from tests.record import scenes
from tests.record.described import described, steady

HERE = Path(__file__).parent / "python"
ROOT = str(Path(sshade.__file__).parents[1]) + os.sep
PACKAGES = tuple(f"{ROOT}{package}{os.sep}" for package in ("sshade", "baselines", "defaust", "eval"))
#: Modules of helpers, and the least lines of a function whose calls are recorded.
HELPERS, LEAST = f"{ROOT}sshade{os.sep}core{os.sep}", 5
#: Whether calls are counted. From Python 3.12 on, profilers hear nothing of kernels, and two threads may
#: compute a cached property.
COUNTS = sys.version_info < (3, 12)
#: Functions of other libraries that take long.
HEAVY = {"splu", "eigsh", "eigh", "svd", "lstsq", "expm", "ConvexHull", "Delaunay", "dijkstra", "min_weight"}
HEAVY |= {"safe_load", "file_digest"}


def transcripts() -> list[str]:
    """Return the names of all scenes."""
    return list(scenes.SCENES)


def recorded(name: str) -> list[str]:
    """Return the recorded lines of a scene, as far as this Python can repeat them."""
    return comparable((HERE / f"{name}.txt").read_text("utf-8").splitlines())


def comparable(lines: list[str]) -> list[str]:
    """Return the lines that this Python can repeat."""
    return [line for line in lines if COUNTS or not re.match(r"\d+ calls ", line)]


def counts(calls: Mapping[str, int]) -> list[str]:
    """Return a line for the calls of each function, if this Python counts them all."""
    return [f"{count} calls {function}" for function, count in sorted(calls.items()) if COUNTS]


def played(name: str) -> list[str]:
    """Play a scene, then again with one CPU where calls count, and return its record."""
    with logged() as said:
        lines = [line for label, value in scenes.SCENES[name]() for line in described(value, label)]
    lines += [f"logged: {steady(line)}" for line in said]
    if name in scenes.ONCE:
        return lines
    gc.collect()
    tracemalloc.start()
    try:
        with on_one_cpu(), counted() as calls:
            for _ in scenes.SCENES[name]():
                pass
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    return [*lines, *counts(calls), f"peak of {peak / 2**20:.2f} megabytes"]


@cache
def lines_of(code: CodeType) -> int:
    """Return the number of lines of a function."""
    return 1 + max(line for *_, line in code.co_lines() if line) - code.co_firstlineno


@contextmanager
def logged() -> Iterator[list[str]]:
    """Collect what the packages log."""
    said: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: said.append(record.getMessage())  # type: ignore[method-assign]
    logging.getLogger().addHandler(handler)
    try:
        yield said
    finally:
        logging.getLogger().removeHandler(handler)


@contextmanager
def counted() -> Iterator[Counter[str]]:
    """Count the calls of functions of the packages, in all threads that begin meanwhile."""
    calls = Counter[str]()
    lock = threading.Lock()

    def note(frame, event, _):
        if event != "call":
            return
        code = frame.f_code
        name = code.co_qualname
        if code.co_filename.startswith(PACKAGES):
            if "<" in name or code.co_filename.startswith(HELPERS) or lines_of(code) < LEAST:
                return
            module = code.co_filename.removeprefix(ROOT).removesuffix(".py").replace(os.sep, ".")
            with lock:
                calls[f"{module}.{name}"] += 1
        elif code.co_name in HEAVY:
            with lock:
                calls[code.co_name] += 1

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        yield calls
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
