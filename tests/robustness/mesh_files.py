"""Cases: bad meshes in commands other than deform, which :mod:`tools.corpus.bad` tries."""

import numpy as np

from tests.robustness.case import Case, nothing
from tests.robustness.inputs import BODY, cut, folder, mesh

DEFORM = "sshade deform {} pose.json -o out.ply"


#: What stands at the mesh's place on the command line.
NAMES = {
    "a folder for a mesh": ("d.ply", folder("d.ply"), "d.ply: is a folder"),
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
    *(
        Case(name, DEFORM.format(path), given, says=tuple(says))
        for name, (path, given, *says) in NAMES.items()
    ),
    *(Case(call, f"sshade {call}", given, says=tuple(says)) for call, (given, *says) in PLACES.items()),
]
