"""Compile the kernels that ``kernels.txt`` lists: ``python -m tools.compile_kernels``.

In a checkout, ``make`` calls it. The build of a wheel calls it with ``--wheel --into FOLDER``. The machine
code is for the common level of this kind of processor, so a wheel takes the kernels that the checkout has.

With ``--update``, the command writes the list anew from the kernels in the store. Do so after a run of all
tests that began with an empty store.
"""

from __future__ import annotations

import argparse
import os
import shutil
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

from sshade.core import kernel_store as store

#: Signatures that are compiled ahead, one a line: the module, the function and its types of arguments.
LIST = Path(__file__).parent / "kernels.txt"
#: Types by their names. Numba exports `bool` with NumPy 2 only.
TYPES = {**vars(types), "bool": types.boolean}


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tools.compile_kernels", description=__doc__)
    parser.add_argument("--into", metavar="FOLDER", default=str(store.SHIPPED), help="folder of the kernels")
    parser.add_argument("--wheel", action="store_true", help="keep nothing else; skip unknown processors")
    parser.add_argument(
        "--update", action="store_true", help="write the list from the store, and compile nothing"
    )
    args = parser.parse_args()
    os.environ["SSHADE_KERNELS"] = args.into
    if args.update:
        return update()
    target = store.portable_target()
    if target:
        os.environ |= {"NUMBA_CPU_NAME": target[1], "NUMBA_CPU_FEATURES": target[2]}
    elif args.wheel:
        shutil.rmtree(args.into, ignore_errors=True)
        print("no common level is known for the processors of this machine: the wheel has no kernels")
        return None
    begin = time.perf_counter()
    files = compile_all()
    if args.wheel:
        for path in set(store.folders()[0].glob("*-*")) - files:
            path.unlink()
    print(f"{len(files)} kernels are compiled after {time.perf_counter() - begin:.0f} s")
    return None


def compile_all() -> set[Path]:
    """Compile each listed signature in two processes, unless the store has it; return the files."""
    listed = defaultdict(list)
    for line in LIST.read_text("utf-8").splitlines():
        module, function, *words = line.split()
        listed[module].append((function, words))
    modules = sorted(listed, key=lambda module: -len(listed[module]))
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        files = pool.map(compile_module, modules, [listed[module] for module in modules])
        return {path for found in files for path in found}


def compile_module(name: str, signatures: list[tuple[str, list[str]]]) -> list[Path]:
    """Compile the signatures of a module's kernels, or load them from the store; return the files."""
    module, files = import_module(name), []
    for function, words in signatures:
        kernel, types_of_arguments = vars(module)[function], tuple(parse(iter(words), module))
        kernel.compile(types_of_arguments)
        files.append(kernel._cache.path(types_of_arguments, kernel.targetctx))
    return files


def parse(words: Iterator[str], module: ModuleType) -> list[Any]:
    """Return the types in words of :func:`sshade.core.kernel_store.describe`, up to a closing parenthesis."""
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
            found.append(types.Array(TYPES[dtype], int(shape[0]), shape[1], readonly=shape.endswith("r")))
        else:
            found.append(TYPES[word])
    return found


def update() -> None:
    """Write the list from the kernels in the store whose source is today's."""
    lines = set()
    for path in store.folders()[0].glob("*-*"):
        line, _, content = path.read_bytes().partition(b"\n")
        module, function, *_ = line.decode().split()
        source = import_module(module)
        of_file = store._hash_of_file(Path(str(source.__file__)))
        if hasattr(source, function) and content[: store.HASH] == of_file:
            lines.add(line.decode())
    LIST.write_text("".join(f"{line}\n" for line in sorted(lines)), "utf-8")


if __name__ == "__main__":
    sys.exit(main())
