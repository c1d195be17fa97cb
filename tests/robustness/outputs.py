"""Cases: where files come from and go to: odd paths, a full disk; maps."""

from __future__ import annotations

import io
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sshade.io.meshes import read_arrays
from tests.robustness.case import Case, check_refusal, contents, limited, nothing, refused, run
from tests.robustness.inputs import BODY, Given, both, cut, data, folder, garbage, mesh, text

DEFORM = "sshade deform body.ply pose.json -o {}"
REMESH = "sshade remesh body.ply -o n.ply --map {}"
CARRY = "sshade carry body.ply map.npz proxy.ply -o out.ply"


def remeshed() -> None:
    assert run("sshade remesh body.ply -o proxy.ply --map map.npz --vertices 40")[0] == 0


def _map(**changes: Any) -> Given:
    """A sound map with arrays replaced; None leaves one out."""

    def write() -> None:
        remeshed()
        with np.load("map.npz") as stored:
            arrays = dict(stored)
        for name, change in changes.items():
            if change is None:
                del arrays[name]
            else:
                arrays[name] = change(arrays[name]) if callable(change) else change
        np.savez("map.npz", **arrays)

    return write


class _Hostile:
    """Unpickled, it writes a file."""

    def __reduce__(self) -> tuple[Callable, tuple]:
        return Path("hacked").write_text, ("x",)


def _pickled_map() -> None:
    remeshed()
    payload = io.BytesIO()
    np.lib.format.write_array_header_1_0(payload, {"descr": "|O", "fortran_order": False, "shape": (1,)})
    payload.write(pickle.dumps([_Hostile()]))
    with zipfile.ZipFile("map.npz") as old:
        members = {name: old.read(name) for name in old.namelist()}
    with zipfile.ZipFile("map.npz", "w") as new:
        for name, content in (members | {"values.npy": payload.getvalue()}).items():
            new.writestr(name, content)


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
    "no map": (mesh(np.eye(3), [[0, 1, 2]], "proxy.ply"), "map.npz", NOT_A_MAP),
    "an empty map": (both(remeshed, data("map.npz", b"")), NOT_A_MAP),
    "binary garbage for a map": (both(remeshed, garbage("map.npz")), NOT_A_MAP),
    "a cut map": (both(remeshed, cut("map.npz", 0.5)), NOT_A_MAP),
    "a mesh for a map": (both(remeshed, _copy("body.ply", "map.npz")), NOT_A_MAP),
    "a map with a pickle in it": (_pickled_map, NOT_A_MAP),
    "a map that is a pickle": (both(remeshed, data("map.npz", pickle.dumps(_Hostile()))), NOT_A_MAP),
    "a map of an archive of a later version": (_member(6, 99), NOT_A_MAP, "zip file version 9.9"),
    "a map that is encrypted": (_member(8, 1), NOT_A_MAP, "encrypted"),
    "a map of an unknown compression": (_member(10, 77), NOT_A_MAP, "compression"),
    "a map without regions": (_map(region=None), NOT_A_MAP),
    "a map with regions out of range": (_map(region=lambda r: r + 40), "do not fit together"),
    "a map with faces out of range": (_map(faces=lambda f: f + 1), "map.npz"),
    "a map with triangles out of range": (_map(face=lambda f: f - 5), "do not fit together"),
    "a map with samples out of range": (_map(samples=lambda s: s - 400), "map.npz"),
    "a map with NaN": (_map(barycentric=lambda b: np.full_like(b, np.nan)), "map.npz"),
    "a map with barycentric coordinates of two": (_map(barycentric=lambda b: b[:, :2]), "map.npz"),
    "a map with unknown frames": (_map(frames=np.array("quaternion")), "map.npz"),
    "a map with words for values": (_map(values=lambda v: v.astype(str)), "map.npz"),
    "a map of another mesh": (_map(vertices=np.array(99)), "99 vertices, this one has 162"),
    "a map of a mesh with other faces": (both(remeshed, mesh(BODY.V, BODY.F[::-1])), "other faces"),
    "a proxy of other counts": (both(remeshed, mesh(np.eye(3), [[0, 1, 2]], "proxy.ply")), "not (3, 3)"),
    "a proxy with NaN": (both(remeshed, _without_numbers), "proxy.ply: a vertex has a NaN"),
}


def _taken(name: str, path: str, given: Given = nothing, *, call: str = DEFORM) -> Case:
    """The result at a path is that of the sound files under their plain names."""

    def holds() -> None:
        found = read_arrays(path)[0]
        mesh(BODY.V, BODY.F)()
        assert run(DEFORM.format("again.ply"))[0] == 0
        assert np.array_equal(found, read_arrays("again.ply")[0])

    return Case(name, call.format(f"'{path}'"), given, leaves=(path, "body.ply", "again.ply"), holds=holds)


SCRIPTS = both(_copy("body.ply", "Körper 体/模型 ü.ply"), _copy("pose.json", "поза 1.json"))
#: An output, and words of the sentence.
PATHS = {
    DEFORM.format("no/out.ply"): (nothing, "folder no does not exist"),
    DEFORM.format("d.ply"): (folder("d.ply"), "is a folder"),
    DEFORM.format("pose.json/out.ply"): (nothing, "out.ply", "folder"),
    DEFORM.format("out.fbx"): (nothing, "unknown format '.fbx'"),
    DEFORM.format("out"): (nothing, "unknown format ''"),
    DEFORM.format("/proc/out.ply"): (nothing, "/proc/out.ply"),
    DEFORM.format(f"{'x' * 300}.ply"): (nothing, "File name too long"),
    REMESH.format("no/map.npz"): (nothing, "no/map.npz: the folder no does not exist"),
    REMESH.format("m.txt"): (nothing, "m.txt: unknown format"),
}


def _on_a_full_disk(call: str, given: Given = nothing) -> Case:
    """The old output stays, nothing new is left."""

    def attempt() -> None:
        code, out, err = run(call)
        assert code == 0, err  # once with room, so that what is compiled is stored
        before = contents()
        with limited(500):
            check_refusal(run(call), "cannot be written (File too large)")
        assert contents() == before

    return Case(f"full disk: {call}", attempt, given, leaves=(".",))


CASES = [
    *refused(CARRY, MAPS, prefix="carry: "),
    _taken(
        "names in other scripts and with spaces",
        "Körper 体/out é.ply",
        SCRIPTS,
        call="sshade deform 'Körper 体/模型 ü.ply' 'поза 1.json' -o {}",
    ),
    _taken("the output takes the input's place", "body.ply"),
    _taken("an output that is there is replaced", "out.ply", text("out.ply", "old")),
    *(Case(call[:60], call, given, says=tuple(says)) for call, (given, *says) in PATHS.items()),
    *(_on_a_full_disk(DEFORM.format(f"out.{suffix}")) for suffix in ("ply", "obj", "off", "stl")),
    _on_a_full_disk(REMESH.format("map.npz")),
    _on_a_full_disk(CARRY, remeshed),
    _on_a_full_disk("sshade reconstruct body.ply body.ply -o out.ply"),
    _on_a_full_disk("sshade transfer-pose body.ply body.ply body.ply -o out.ply"),
    _on_a_full_disk("sshade show body.ply -o out.png"),
]
