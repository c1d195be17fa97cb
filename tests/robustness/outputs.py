"""Cases: where files come from and go to: odd paths, places that cannot be written, a full disk; maps."""

from __future__ import annotations

import io
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sshade.io.meshes import read_arrays
from tests.robustness.case import Case, limited, run
from tests.robustness.inputs import BODY, Given, both, cut, data, folder, garbage, mesh, text

DEFORM = "sshade deform body.ply pose.json -o {}"
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


def _carry(name: str, given: Given, *says: str) -> Case:
    return Case(f"carry: {name}", CARRY, given, says=says)


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
MAPS = [
    _carry("no map", mesh(np.eye(3), [[0, 1, 2]], "proxy.ply"), "map.npz", NOT_A_MAP),
    _carry("an empty map", both(remeshed, data("map.npz", b"")), NOT_A_MAP),
    _carry("binary garbage for a map", both(remeshed, garbage("map.npz")), NOT_A_MAP),
    _carry("a cut map", both(remeshed, cut("map.npz", 0.5)), NOT_A_MAP),
    _carry(
        "a mesh for a map",
        both(remeshed, _copy("body.ply", "map.npz")),
        NOT_A_MAP,
    ),
    _carry("a map with a pickle in it", _pickled_map, NOT_A_MAP),
    _carry(
        "a map that is a pickle",
        both(remeshed, data("map.npz", pickle.dumps(_Hostile()))),
        NOT_A_MAP,
    ),
    _carry("a map of an archive of a later version", _member(6, 99), NOT_A_MAP, "zip file version 9.9"),
    _carry("a map that is encrypted", _member(8, 1), NOT_A_MAP, "encrypted"),
    _carry("a map of an unknown compression", _member(10, 77), NOT_A_MAP, "compression"),
    _carry("a map without regions", _map(region=None), NOT_A_MAP),
    _carry("a map with regions out of range", _map(region=lambda r: r + 40), "do not fit together"),
    _carry("a map with faces out of range", _map(faces=lambda f: f + 1), "map.npz"),
    _carry("a map with triangles out of range", _map(face=lambda f: f - 5), "do not fit together"),
    _carry("a map with samples out of range", _map(samples=lambda s: s - 400), "map.npz"),
    _carry("a map with NaN", _map(barycentric=lambda b: np.full_like(b, np.nan)), "map.npz"),
    _carry("a map with barycentric coordinates of two", _map(barycentric=lambda b: b[:, :2]), "map.npz"),
    _carry("a map with unknown frames", _map(frames=np.array("quaternion")), "map.npz"),
    _carry("a map with words for values", _map(values=lambda v: v.astype(str)), "map.npz"),
    _carry("a map of another mesh", _map(vertices=np.array(99)), "a mesh with 99 vertices, this one has 162"),
    _carry("a map of a mesh with other faces", both(remeshed, mesh(BODY.V, BODY.F[::-1])), "other faces"),
    _carry(
        "an edited proxy of other counts",
        both(remeshed, mesh(np.eye(3), [[0, 1, 2]], "proxy.ply")),
        "not (3, 3)",
    ),
    _carry(
        "an edited proxy with NaN",
        both(
            remeshed,
            lambda: mesh(
                np.full_like(read_arrays("proxy.ply")[0], np.nan), read_arrays("proxy.ply")[1], "proxy.ply"
            )(),
        ),
        "proxy.ply: a vertex has a NaN",
    ),
]


def _is_the_sound_result(path: str) -> Callable[[], None]:
    def holds() -> None:
        before = read_arrays(path)[0]
        if path == "body.ply":
            mesh(BODY.V, BODY.F)()
        assert run(DEFORM.format("again.ply"))[0] == 0
        assert np.array_equal(before, read_arrays("again.ply")[0])

    return holds


PATHS = [
    Case(
        "names in other scripts and with spaces",
        "sshade deform 'Körper 体/模型 ü.ply' 'поза 1.json' -o 'Körper 体/out é.ply'",
        both(_copy("body.ply", "Körper 体/模型 ü.ply"), _copy("pose.json", "поза 1.json")),
        leaves=("Körper 体/out é.ply", "again.ply"),
        holds=_is_the_sound_result("Körper 体/out é.ply"),
    ),
    Case(
        "the output takes the input's place",
        DEFORM.format("body.ply"),
        leaves=("body.ply", "again.ply"),
        holds=_is_the_sound_result("body.ply"),
    ),
    Case(
        "an output that is there is replaced",
        DEFORM.format("out.ply"),
        text("out.ply", "old"),
        leaves=("out.ply", "again.ply"),
        holds=_is_the_sound_result("out.ply"),
    ),
    Case("an output in a missing folder", DEFORM.format("no/out.ply"), says=("folder no does not exist",)),
    Case("an output that is a folder", DEFORM.format("d.ply"), folder("d.ply"), says=("is a folder",)),
    Case("an output below a file", DEFORM.format("pose.json/out.ply"), says=("out.ply", "folder")),
    Case("an output of an unknown format", DEFORM.format("out.glb"), says=("unknown mesh format '.glb'",)),
    Case("an output without a suffix", DEFORM.format("out"), says=("unknown mesh format ''",)),
    Case("an output in a system folder", DEFORM.format("/proc/out.ply"), says=("/proc/out.ply",)),
    Case("an output named by 300 letters", DEFORM.format(f"{'x' * 300}.ply"), says=("File name too long",)),
    Case(
        "a map in a missing folder",
        "sshade remesh body.ply -o n.ply --map no/map.npz",
        says=("no/map.npz: the map must be an .npz file in a folder that exists",),
    ),
    Case(
        "a map of an unknown format",
        "sshade remesh body.ply -o n.ply --map m.txt",
        says=("m.txt: the map must be",),
    ),
]

#: Bytes that a file may have where the disk is "full".
LITTLE = 500


def _on_a_full_disk(name: str, call: str, given: Given = lambda: None) -> Case:
    """The old output stays, nothing new is left."""

    def attempt() -> None:
        code, out, err = run(call)
        assert code == 0, err  # once with room, so that what is compiled is stored
        before = {p: p.read_bytes() for p in Path().rglob("*") if p.is_file()}
        with limited(LITTLE):
            code, out, err = run(call)
        assert code == 2 and err.startswith("error: ") and err.count("\n") == 1, (code, err)
        assert "cannot be written (File too large)" in err, err
        assert before == {p: p.read_bytes() for p in Path().rglob("*") if p.is_file()}

    return Case(f"full disk: {name}", attempt, given, leaves=(".",))


FULL = [
    _on_a_full_disk("deform to PLY", DEFORM.format("out.ply")),
    _on_a_full_disk("deform to OBJ", DEFORM.format("out.obj")),
    _on_a_full_disk("deform to OFF", DEFORM.format("out.off")),
    _on_a_full_disk("deform to STL", DEFORM.format("out.stl")),
    _on_a_full_disk("remesh", "sshade remesh body.ply -o n.ply --map map.npz"),
    _on_a_full_disk("carry", CARRY, remeshed),
    _on_a_full_disk("reconstruct", "sshade reconstruct body.ply body.ply -o out.ply"),
    _on_a_full_disk("transfer-pose", "sshade transfer-pose body.ply body.ply body.ply -o out.ply"),
    _on_a_full_disk("show", "sshade show body.ply -o out.png"),
]
CASES = [*MAPS, *PATHS, *FULL]
