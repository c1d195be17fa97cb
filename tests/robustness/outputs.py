"""Cases: odd paths, full disks, maps, and meshes that go with another mesh."""

from pathlib import Path

import numpy as np

from sshade.files.meshes import read_arrays
from tests.robustness.case import Case, nothing, on_a_full_disk, refused, run
from tests.robustness.inputs import BODY, Given, both, data, mesh
from tests.shapes import bumpy

DEFORM = "sshade deform body.ply pose.json -o {}"
POSES = "sshade deform body.ply pose.json pose.json -o out.glb --vertices 60"
REMESH = "sshade remesh body.ply -o n.ply --map {}"
CARRY = "sshade carry body.ply map.npz proxy.ply -o out.ply"


def remeshed() -> None:
    assert run("sshade remesh body.ply -o proxy.ply --map map.npz --vertices 40")[0] == 0


def _copy(source: str, target: str) -> Given:
    return lambda: data(target, Path(source).read_bytes())()


def _without_numbers() -> None:
    V, F = read_arrays("proxy.ply")
    mesh(np.full_like(V, np.nan), F, "proxy.ply")()


def _member(offset: int, value: int) -> Given:
    """A sound map with two bytes of its archive's first entry replaced."""

    def write() -> None:
        remeshed()
        content = bytearray(Path("map.npz").read_bytes())
        at = content.index(b"PK\x01\x02") + offset
        content[at : at + 2] = value.to_bytes(2, "little")
        Path("map.npz").write_bytes(content)

    return write


NOT_A_MAP = "not a map written by `sshade remesh`"
MAPS = {
    "a map of an archive of a later version": (_member(6, 99), NOT_A_MAP, "zip file version 9.9"),
    "a map that is encrypted": (_member(8, 1), NOT_A_MAP, "encrypted"),
    "a map of an unknown compression": (_member(10, 77), NOT_A_MAP, "compression"),
    "a map of another mesh": (both(remeshed, mesh(bumpy(1).V, bumpy(1).F)), "162 vertices, this one has 42"),
    "a map of a mesh with other faces": (both(remeshed, mesh(BODY.V, BODY.F[::-1])), "other faces"),
    "a proxy of other counts": (both(remeshed, mesh(np.eye(3), [[0, 1, 2]], "proxy.ply")), "has 3 vert"),
    "a proxy with NaN": (both(remeshed, _without_numbers), "proxy.ply: vertex"),
}


def _taken(name: str, path: str, given: Given = nothing, *, call: str = DEFORM) -> Case:
    """Return a case whose result at `path` equals the result from the sound files with plain names."""

    def holds() -> None:
        found = read_arrays(path)[0]
        mesh(BODY.V, BODY.F)()
        assert run(DEFORM.format("again.ply"))[0] == 0
        assert np.array_equal(found, read_arrays("again.ply")[0])

    return Case(name, call.format(f"'{path}'"), given, leaves=(path, "body.ply", "again.ply"), holds=holds)


SCRIPTS = both(_copy("body.ply", "Körper 体/模型 ü.ply"), _copy("pose.json", "поза 1.json"))

WITH = "sshade deform body.ply pose.json -o out.ply --with extra.ply"
FAR = mesh(BODY.V + 100, BODY.F, "extra.ply")
COMPANIONS = {
    "a missing file": (nothing, "extra.ply: no such file"),
    "a mesh far away": (FAR, "extra.ply: 162 of 162 points are too far from the box of the mesh"),
}

CASES = [
    *refused(WITH, COMPANIONS, prefix="with: "),
    *refused(CARRY, MAPS, prefix="carry: "),
    _taken(
        "names in other scripts and with spaces",
        "Körper 体/out é.ply",
        SCRIPTS,
        call="sshade deform 'Körper 体/模型 ü.ply' 'поза 1.json' -o {}",
    ),
    _taken("the output takes the input's place if asked", "body.ply", call=f"{DEFORM} --overwrite"),
    Case("an output among processes", DEFORM.format("/proc/out.ply"), says=("/proc/out.ply",)),
    *(on_a_full_disk(DEFORM.format(f"out.{suffix}")) for suffix in ("ply", "obj", "off", "stl")),
    on_a_full_disk(POSES),
    on_a_full_disk(REMESH.format("map.npz")),
    on_a_full_disk(CARRY, remeshed),
    on_a_full_disk("sshade reconstruct body.ply body.ply -o out.ply"),
    on_a_full_disk("sshade transfer-pose body.ply body.ply body.ply -o out.ply"),
    on_a_full_disk("sshade show body.ply -o out.html"),
    Case("an extension that is no zip", "sshade blender -o out.tar", says=("out.tar", "use .zip")),
    Case("an extension nowhere", "sshade blender -o no/out.zip", says=("the folder no does not exist",)),
]
