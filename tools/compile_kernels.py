"""Compile the kernels that ``kernels.txt`` lists: ``python -m tools.compile_kernels``.

In a checkout, ``make`` calls it once after installing. The build of a wheel calls it with ``--portable
--into FOLDER``. With ``--update``, it writes the list anew from the kernels in the store. Do so after a run
of all tests that began with an empty store.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from types import ModuleType
from typing import Any

from numba.core import types

from sshade.kernels import HASH, MADE_FOR, SHIPPED, _hash_of_file, folders, made_for, portable_target

#: Signatures that are compiled ahead, one a line: the module, the function and its types of arguments.
LIST = Path(__file__).parent / "kernels.txt"


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tools.compile_kernels", description=__doc__)
    parser.add_argument("--into", metavar="FOLDER", default=str(SHIPPED), help="folder of the kernels")
    parser.add_argument("--portable", action="store_true", help="for the common level of these processors")
    parser.add_argument(
        "--update", action="store_true", help="write the list from the store, and compile nothing"
    )
    args = parser.parse_args()
    os.environ["SSHADE_KERNELS"] = args.into
    if args.update:
        return update()
    if args.portable:
        target = portable_target()
        if target is None:
            print("no level of processors is known for this machine: no kernels are shipped")
            return None
        os.environ |= {"NUMBA_CPU_NAME": target[1], "NUMBA_CPU_FEATURES": target[2]}
    begin = time.perf_counter()
    number = compile_all()
    print(f"compiled {number} kernels in {time.perf_counter() - begin:.0f} s")
    return None


def compile_all() -> int:
    """Compile each listed signature in two processes; return the number of signatures."""
    listed = defaultdict(list)
    for line in LIST.read_text("utf-8").splitlines():
        module, function, *words = line.split()
        listed[module].append((function, words))
    modules = sorted(listed, key=lambda module: -len(listed[module]))
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        list(pool.map(compile_module, modules, [listed[module] for module in modules]))
        made = pool.submit(made_for).result()
    (folders()[0] / MADE_FOR).write_text(made, "utf-8")
    return sum(map(len, listed.values()))


def compile_module(name: str, signatures: list[tuple[str, list[str]]]) -> None:
    """Compile the signatures of a module's kernels, or load them from the store."""
    module = import_module(name)
    for function, words in signatures:
        vars(module)[function].compile(tuple(parse(iter(words), module)))


def parse(words: Iterator[str], module: ModuleType) -> list[Any]:
    """Return the types in words of :func:`sshade.kernels.describe`, up to a closing parenthesis."""
    found: list[Any] = []
    for word in words:
        if word == ")":
            break
        if word.endswith("("):
            members = parse(words, module)
            name = word[:-1]
            found.append(types.NamedTuple(members, vars(module)[name]) if name else types.Tuple(members))
        elif ":" in word:
            dtype, shape = word.split(":")
            found.append(
                types.Array(vars(types)[dtype], int(shape[0]), shape[1], readonly=shape.endswith("r"))
            )
        else:
            found.append(vars(types)[word])
    return found


def update() -> None:
    """Write the list from the kernels in the store whose source is today's."""
    lines = set()
    for path in folders()[0].glob("*-*"):
        line, _, content = path.read_bytes().partition(b"\n")
        module, function, *_ = line.decode().split()
        source = import_module(module)
        if hasattr(source, function) and content[:HASH] == _hash_of_file(Path(str(source.__file__))):
            lines.add(line.decode())
    LIST.write_text("".join(f"{line}\n" for line in sorted(lines)), "utf-8")


if __name__ == "__main__":
    sys.exit(main())
