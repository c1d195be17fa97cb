"""Run the command on one mesh, in this process, and judge how it ends."""

from __future__ import annotations

import contextlib
import hashlib
import io
import shutil
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tools.corpus.case import Case
from tools.corpus.cases import cases
from tools.corpus.check import STRETCH, STRETCH_OF_FEW, faults
from tools.corpus.document import Document, read
from tools.corpus.handles import Made, made
from tools.corpus.joints import Joints

DEFORMED, REFUSED, WRONG = "deformed", "refused", "wrong"
#: Lines of the first call on a machine, which compiles kernels.
ANNOUNCEMENTS = ("compiling kernels", "compiled in")
#: What a message of a result begins with, after the line that names the output.
KNOWN = ("note: ", "warning: ")
#: Allowed stretch of edges in meshes of the user, whose handles may be nearer to each other.
OWN_STRETCH = 3.0
#: Slope of handles that a case brings, see :class:`tools.corpus.handles.Made`.
SLOPE = 3.0
#: Characters of the longest message.
LONGEST = 420
#: Suffixes of files that meshes refer to.
COMPANIONS = (".bin", ".mtl")
#: For files that are not read: any handle file that is sound.
ANY_HANDLES = b'{"handles": [{"vertices": [0]}]}'


class Outcome(NamedTuple):
    """How a method ended on a mesh: a verdict, and the reason of a refusal or what is wrong."""

    name: str
    method: str
    verdict: str
    text: str = ""


def try_named(name: str, methods: Sequence[str], folder: Path, keep: bool) -> list[Outcome]:
    """Try the case of a name: a worker process receives only names."""
    (case,) = (case for case in cases() if case.name == name)
    return try_case(case, methods, folder, keep=keep)


def try_case(case: Case, methods: Sequence[str], folder: Path, *, keep: bool = False) -> list[Outcome]:
    """Write the files of a case and run every method on them; remove the files unless they are to be kept."""
    home = folder / case.name
    case.write(home)
    found = _try_mesh(case, home / case.file, methods)
    if not keep:
        shutil.rmtree(home)
    return found


def try_own(
    path: Path, name: str, methods: Sequence[str], folder: Path, *, keep: bool = False
) -> list[Outcome]:
    """Run every method on a copy of a mesh file of the user."""
    home = folder / name
    home.mkdir(parents=True)
    companions = (p for p in path.parent.iterdir() if p.suffix.lower() in COMPANIONS)
    for file in (path, *companions):
        shutil.copy(file, home)
    found = _try_mesh(Case(name, path.name, dict), home / path.name, methods, own=True)
    if not keep:
        shutil.rmtree(home)
    return found


def _try_mesh(case: Case, mesh: Path, methods: Sequence[str], *, own: bool = False) -> list[Outcome]:
    rest, joints, handles, unread = None, None, None, ""
    try:
        if not case.refused:
            rest = read(mesh)
            joints = Joints(rest)
            handles = made(rest, joints, case.name)
            if case.expected:
                index, target = case.expected
                slope = np.full_like(handles.slope, SLOPE)
                handles = Made(index, target, np.zeros(len(index)), slope, complete=False)
    except Exception as error:  # the file may be damaged: then the command has to refuse it
        unread = f"{type(error).__name__}: {error}"
    file = mesh.parent / "handles.json"
    content = handles.content(rest, mesh) if rest and handles else ANY_HANDLES
    file.write_bytes(content if case.handles is None else case.handles)
    return [
        Outcome(case.name, method, *_ended(case, method, mesh, file, (rest, joints, handles), unread, own))
        for method in methods
    ]


def _ended(
    case: Case,
    method: str,
    mesh: Path,
    file: Path,
    known: tuple[Document | None, Joints | None, Made | None],
    unread: str,
    own: bool,
) -> tuple[str, str]:
    """Return the verdict on a run and its reason."""
    output = mesh.parent / f"deformed_{method}{case.output or mesh.suffix}"
    before = _contents(mesh.parent)
    arguments = ["deform", str(mesh), str(file), "-o", str(output), "--method", method]
    code, printed, lines = call(arguments)
    after = _contents(mesh.parent)
    left = sorted(
        {str(p) for p in after if before.get(p) != after[p]} | {str(p) for p in before.keys() - after}
    )
    if isinstance(code, str):
        return WRONG, code
    if printed:
        return WRONG, f"printed on standard output: {printed[:80]!r}"
    if code != 0:
        return _refused(case, mesh, code, lines, left, own)
    if case.refused:
        return WRONG, f"was deformed, but must be refused with {' or '.join(map(repr, case.refused))}"
    if left != [str(output)]:
        return WRONG, f"changed or left behind: {', '.join(left)}"
    found = _said(case, output, lines)
    rest, joints, handles = known
    if rest is None or joints is None or handles is None:
        return WRONG, f"was deformed, but the reader of the corpus says {unread}"
    stretch = OWN_STRETCH if own else STRETCH_OF_FEW if handles.few else STRETCH
    limits = {"within": case.within, "stretch": stretch}
    found += faults(rest, read(output), joints, handles, lines, same_format=not case.output, **limits)
    return (WRONG, "; ".join(found)) if found else (DEFORMED, "")


def call(arguments: Sequence[str]) -> tuple[int | str, str, list[str]]:
    """Run the command; return its exit code or what it raised, its output, and its messages."""
    from sshade.cli.main import main

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code: int | str = main(arguments)
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            code = f"raised {type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
    lines = err.getvalue().splitlines()
    return code, out.getvalue(), [line for line in lines if not line.startswith(ANNOUNCEMENTS)]


def _refused(
    case: Case, mesh: Path, code: int, lines: list[str], left: list[str], own: bool
) -> tuple[str, str]:
    """A refusal has exit code 2 and one sentence, leaves nothing, and is expected."""
    text = " ".join(lines)
    if code != 2 or len(lines) != 1 or not text.startswith("error: ") or len(text) > LONGEST:
        return WRONG, f"ended with exit code {code} and {len(lines)} lines: {text[:300]}"
    if left:
        return WRONG, f"was refused, but left {', '.join(left)}"
    reason = text.replace(str(mesh.parent), "")
    if own or any(word in reason for word in case.refused):
        return REFUSED, text.removeprefix("error: ")
    return WRONG, f"{'refused for another reason' if case.refused else 'refused'}: {text}"


def _said(case: Case, output: Path, lines: list[str]) -> list[str]:
    """A message names the output, all others are notes and warnings, and none repeats."""
    result = [line for line in lines if line.startswith(f"{output}: ")]
    others = [line for line in lines if line not in result and not line.startswith(KNOWN)]
    found = [f"an unexpected message: {line[:120]}" for line in dict.fromkeys(others)]
    if len(result) != 1:
        found.append(f"{len(result)} messages name the output")
    if len(set(lines)) < len(lines):
        found.append("a message is repeated")
    text = "\n".join(lines)
    return found + [f"no message says {word!r}" for word in case.says if word not in text]


def _contents(folder: Path) -> dict[Path, str]:
    """Return a hash of every file in a folder."""
    return {p: hashlib.sha256(p.read_bytes()).hexdigest() if p.is_file() else "" for p in folder.rglob("*")}
