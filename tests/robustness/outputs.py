"""Cases: names of outputs, and full disks."""

from pathlib import Path

import numpy as np

from sshade.files.meshes import read_arrays
from tests.robustness.case import Case, nothing, on_a_full_disk, run
from tests.robustness.inputs import BODY, Given, both, data, mesh

DEFORM = "sshade deform body.ply pose.json -o {}"
POSES = "sshade deform body.ply pose.json pose.json -o out.glb --vertices 60"
REMESH = "sshade remesh body.ply -o proxy.ply --map map.npz --vertices 40"
CARRY = "sshade carry body.ply map.npz proxy.ply -o out.ply"


def remeshed() -> None:
    assert run(REMESH)[0] == 0


def _copy(source: str, target: str) -> Given:
    return lambda: data(target, Path(source).read_bytes())()


def _taken(name: str, path: str, given: Given = nothing, *, call: str = DEFORM) -> Case:
    """Return a case whose result at `path` equals the result from the sound files with plain names."""

    def holds() -> None:
        found = read_arrays(path)[0]
        mesh(BODY.V, BODY.F)()
        assert run(DEFORM.format("again.ply"))[0] == 0
        assert np.array_equal(found, read_arrays("again.ply")[0])

    return Case(name, call.format(f"'{path}'"), given, leaves=(path, "body.ply", "again.ply"), holds=holds)


SCRIPTS = both(_copy("body.ply", "Körper 体/模型 ü.ply"), _copy("pose.json", "поза 1.json"))

CASES = [
    _taken(
        "names in other scripts and with spaces",
        "Körper 体/out é.ply",
        SCRIPTS,
        call="sshade deform 'Körper 体/模型 ü.ply' 'поза 1.json' -o {}",
    ),
    _taken("the output takes the input's place if asked", "body.ply", call=f"{DEFORM} --overwrite"),
    *(on_a_full_disk(DEFORM.format(f"out.{suffix}")) for suffix in ("ply", "obj", "stl")),
    on_a_full_disk(POSES),
    on_a_full_disk(REMESH),
    on_a_full_disk(CARRY, remeshed),
    on_a_full_disk("sshade show body.ply -o out.html"),
]
