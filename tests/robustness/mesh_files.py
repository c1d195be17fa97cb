"""Cases: files that hold no mesh, or not the one that they announce."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sshade.io.meshes import SUFFIXES
from tests.robustness.case import Case
from tests.robustness.inputs import BODY, Given, both, cut, data, folder, garbage, mesh, patched, text

DEFORM = "sshade deform body.ply pose.json -o out.ply"
MAP = "sshade remesh body.ply -o proxy.ply --map map.npz --vertices 40"

HEADER = (
    "ply\nformat ascii 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\n"
    "element face {m}\nproperty list uchar int vertex_indices\nend_header\n"
)
TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n"


def _of_each_format() -> list[Case]:
    cases = []
    for suffix in SUFFIXES:
        path, format_ = f"body{suffix}", suffix[1:].upper()
        other = ".off" if suffix == ".ply" else ".ply"
        command = f"sshade deform {path} pose.json -o out.ply"
        sound = mesh(BODY.V, BODY.F, path)
        damages: dict[str, tuple[Given, tuple[str, ...]]] = {
            "empty": (data(path, b""), (path, "the file is empty")),
            "blank": (data(path, b"\n \n"), (path,)),
            "binary garbage": (garbage(path), (path,)),
            "a web page": (text(path, "<!DOCTYPE html>\n<title>404 Not Found</title>\n"), (path,)),
            "only zeros": (data(path, bytes(4096)), (path,)),
            "cut in its first line": (both(sound, cut(path, 0.0004)), (path,)),
            "cut in its vertices": (both(sound, cut(path, 0.2)), (path,)),
            "cut in its faces": (both(sound, cut(path, 0.9)), (path,)),
            "cut in its last face": (both(sound, cut(path, -5)), (path,)),
            f"content of a {other[1:].upper()} file": (
                both(mesh(BODY.V, BODY.F, f"x{other}"), lambda p=path, o=other: _copy(f"x{o}", p)),
                (path,),
            ),
        }
        cases += [
            Case(f"{format_}: {name}", command, given, says=says) for name, (given, says) in damages.items()
        ]
    return cases


def _copy(source: str, target: str) -> None:
    data(target, Path(source).read_bytes())()


def _announcing(n: object, m: object) -> Given:
    return text("body.ply", HEADER.format(n=n, m=m) + TRIANGLE + "3 0 1 2\n")


CONTENT = [
    Case(
        "PLY: announces 10^12 vertices", DEFORM, _announcing(10**12, 1), says=("body.ply", "not a readable")
    ),
    Case("PLY: announces 10^12 faces", DEFORM, _announcing(3, 10**12), says=("body.ply", "not a readable")),
    Case("PLY: announces 10^30 faces", DEFORM, _announcing(3, 10**30), says=("body.ply", "not a readable")),
    Case("PLY: announces -3 vertices", DEFORM, _announcing(-3, 1), says=("body.ply", "not a readable")),
    Case("PLY: announces no number", DEFORM, _announcing("many", 1), says=("body.ply", "not a readable")),
    Case(
        "PLY: points without faces",
        DEFORM,
        text("body.ply", HEADER.format(n=3, m=0) + TRIANGLE),
        says=("body.ply",),
    ),
    Case(
        "PLY: a header without its end",
        DEFORM,
        both(mesh(BODY.V, BODY.F), patched("body.ply", b"end_header\n", b"")),
        says=("body.ply", "not a readable PLY file"),
    ),
    Case(
        "PLY: faces of an unknown type",
        DEFORM,
        both(mesh(BODY.V, BODY.F), patched("body.ply", b"list uchar int", b"list uchar word")),
        says=("body.ply", "not a readable PLY file"),
    ),
    Case(
        "OFF: more faces announced than there are",
        "sshade deform body.off pose.json -o out.ply",
        text("body.off", f"OFF\n3 2 0\n{TRIANGLE}3 0 1 2\n"),
        says=("2 faces are announced",),
    ),
    Case(
        "OFF: counts that are no numbers",
        "sshade deform body.off pose.json -o out.ply",
        text("body.off", f"OFF\nthree one 0\n{TRIANGLE}3 0 1 2\n"),
        says=("body.off", "not a readable OFF file"),
    ),
    Case(
        "OFF: header alone",
        "sshade deform body.off pose.json -o out.ply",
        text("body.off", "OFF\n"),
        says=("body.off", "not a readable OFF file"),
    ),
    Case(
        "OFF: a face of no corners",
        "sshade deform body.off pose.json -o out.ply",
        text("body.off", f"OFF\n3 1 0\n{TRIANGLE}0\n"),
        says=("body.off",),
    ),
    Case(
        "OBJ: a coordinate that is no number",
        "sshade deform body.obj pose.json -o out.ply",
        text("body.obj", "v 0 0 zero\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        says=("body.obj", "not a readable OBJ file"),
    ),
    Case(
        "OBJ: a face with vertex 0",
        "sshade deform body.obj pose.json -o out.ply",
        text("body.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n"),
        says=("line 4", "counted from 1"),
    ),
    Case(
        "OBJ: comments alone",
        "sshade deform body.obj pose.json -o out.ply",
        text("body.obj", "# an empty scene\n"),
        says=("body.obj", "no triangles"),
    ),
    Case(
        "STL: two solids",
        "sshade deform body.stl pose.json -o out.ply",
        text(
            "body.stl",
            "".join(
                f"solid {i}\nfacet normal 0 0 1\nouter loop\nvertex 0 0 {i}\nvertex 1 0 {i}\nvertex 0 1 {i}\n"
                f"endloop\nendfacet\nendsolid {i}\n"
                for i in range(2)
            ),
        ),
        says=("2 meshes; give one mesh a file",),
    ),
    Case(
        "unknown suffix",
        "sshade deform body.glb pose.json -o out.ply",
        garbage("body.glb"),
        says=(".glb", ".ply"),
    ),
    Case(
        "no suffix", "sshade deform body pose.json -o out.ply", garbage("body"), says=("unknown mesh format",)
    ),
    Case(
        "a folder for a mesh",
        "sshade deform d.ply pose.json -o out.ply",
        folder("d.ply"),
        says=("no such file",),
    ),
    Case(
        "a missing mesh",
        "sshade deform nowhere.ply pose.json -o out.ply",
        says=("nowhere.ply: no such file",),
    ),
]

#: Each place of a command line that takes a mesh or a map, with a bad one there.
PLACES = [
    Case("remesh: a cut mesh", MAP, cut("body.ply", 0.5), says=("body.ply", "not a readable PLY")),
    Case("show: a cut mesh", "sshade show body.ply -o out.png", cut("body.ply", 0.5), says=("body.ply",)),
    Case(
        "show: a deformed shape of other counts",
        "sshade show body.ply --deformed less.ply -o out.png",
        mesh(np.eye(3), [[0, 1, 2]], "less.ply"),
        says=("less.ply has 3 vertices",),
    ),
    Case(
        "show: an unknown picture format",
        "sshade show body.ply -o out.exr",
        says=("unknown picture format '.exr'",),
    ),
    Case(
        "show: a picture in a missing folder",
        "sshade show body.ply -o nowhere/out.png",
        says=("nowhere does not exist",),
    ),
    Case(
        "reconstruct: a pose of other counts",
        "sshade reconstruct body.ply less.ply -o out.ply",
        mesh(np.eye(3), [[0, 1, 2]], "less.ply"),
        says=("they must correspond",),
    ),
    Case(
        "reconstruct: a pose with NaN",
        "sshade reconstruct body.ply nan.ply -o out.ply",
        mesh(np.where(np.arange(BODY.n)[:, None] == 4, np.nan, BODY.V), BODY.F, "nan.ply"),
        says=("NaN or infinite",),
    ),
    Case(
        "transfer-pose: an edited shape of other counts",
        "sshade transfer-pose body.ply body.ply less.ply -o out.ply",
        mesh(np.eye(3), [[0, 1, 2]], "less.ply"),
        says=("edited", "they must correspond"),
    ),
]
CASES = [*_of_each_format(), *CONTENT, *PLACES]
