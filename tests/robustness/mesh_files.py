"""Cases: files that hold no mesh, or not the one that they announce."""

from pathlib import Path

import numpy as np

from sshade.io.meshes import SUFFIXES
from tests.robustness.case import Case, nothing, refused
from tests.robustness.inputs import BODY, Given, both, cut, data, folder, garbage, mesh, text

DEFORM = "sshade deform {} pose.json -o out.ply"


def _of_each_format() -> list[Case]:
    cases = []
    for suffix in SUFFIXES:
        path, other = f"body{suffix}", ".off" if suffix == ".ply" else ".ply"
        sound, foreign = mesh(BODY.V, BODY.F, path), mesh(BODY.V, BODY.F, f"x{other}")
        damages: dict[str, Given] = {
            "empty": data(path, b""),
            "binary garbage": garbage(path),
            "a web page": text(path, "<!DOCTYPE html>\n<title>404 Not Found</title>\n"),
            "only zeros": data(path, bytes(4096)),
            "cut in its last face": both(sound, cut(path, -5)),
            f"content of {other}": both(foreign, lambda p=path, o=other: Path(f"x{o}").rename(p)),
        }
        table = {name: (given, path) for name, given in damages.items()}
        cases += refused(DEFORM.format(path), table, prefix=f"{suffix}: ")
    return cases


def _announcing(n: object, m: object, points: str = "0 0 0\n1 0 0\n0 1 0\n") -> Given:
    """A PLY file of three vertices and a face that announces other counts."""
    header = f"ply\nformat ascii 1.0\nelement vertex {n}\n" + "".join(f"property float {c}\n" for c in "xyz")
    header += f"element face {m}\nproperty list uchar int vertex_indices\nend_header\n"
    return text("body.ply", f"{header}{points}3 0 1 2\n" if m else header + points)


PLY = {
    "announces 10^12 vertices": (_announcing(10**12, 1), "body.ply", "not a readable"),
    "announces 10^12 faces": (_announcing(3, 10**12), "body.ply", "not a readable"),
    "points without faces": (_announcing(3, 0), "body.ply"),
}
#: What stands at the mesh's place on the command line.
NAMES = {
    "unknown suffix": ("body.fbx", garbage("body.fbx"), ".fbx", ".ply"),
    "no suffix": ("body", garbage("body"), "unknown format"),
    "a folder for a mesh": ("d.ply", folder("d.ply"), "d.ply: is a folder"),
    "comments alone": ("body.obj", text("body.obj", "# an empty scene\n"), "body.obj", "no triangles"),
    "a missing mesh": ("nowhere.ply", nothing, "nowhere.ply: no such file"),
}
LESS = mesh(np.eye(3), [[0, 1, 2]], "less.ply")
NAN = mesh(np.where(np.arange(BODY.n)[:, None] == 4, np.nan, BODY.V), BODY.F, "nan.ply")
#: Each other command that takes a mesh, with a bad one.
PLACES = {
    "remesh body.ply -o out.ply --map m.npz": (cut("body.ply", 0.5), "body.ply", "not a readable PLY"),
    "show body.ply --deformed less.ply -o out.png": (LESS, "less.ply has 3 vertices and body.ply has"),
    "show body.ply -o out.exr": (nothing, "'.exr'"),
    "show body.ply -o nowhere/out.png": (nothing, "nowhere does not exist"),
    "reconstruct body.ply less.ply -o out.ply": (LESS, "they must correspond"),
    "reconstruct body.ply nan.ply -o out.ply": (NAN, "NaN or infinite"),
    "transfer-pose body.ply body.ply less.ply -o out.ply": (LESS, "less.ply", "they must correspond"),
}
CASES = [
    *_of_each_format(),
    *refused(DEFORM.format("body.ply"), PLY, prefix="PLY: "),
    *(
        Case(name, DEFORM.format(path), given, says=tuple(says))
        for name, (path, given, *says) in NAMES.items()
    ),
    *(Case(call, f"sshade {call}", given, says=tuple(says)) for call, (given, *says) in PLACES.items()),
]
