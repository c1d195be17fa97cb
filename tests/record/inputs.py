"""Files with which transcripts begin."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from sshade import Mesh
from sshade.files.mesh_file import SUFFIXES
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles
from tests.files import SAMPLES
from tests.robustness.inputs import BODY, pose, write_sound
from tests.robustness.working import cut
from tests.robustness.working import runs as runs
from tests.shapes import as_obj, bent, end_handles, rotation, strip, torn
from tests.sshade.mesh.test_cutting import moebius, t_fin
from tests.write import mesh_ply

V, F = BODY.V, BODY.F


def handles(name: str, *entries: dict, **more) -> None:
    """Write a handle file of entries."""
    Path(name).write_text(json.dumps({"handles": list(entries), **more}))


def bodies() -> None:
    """Write a body, poses of it with handles of all kinds, the bent body, and the body as other files."""
    write_sound()
    write_mesh("bent.ply", bent(V), F)
    write_mesh("grown.ply", V * [1.1, 1, 1], F)
    Path("seam.obj").write_text(as_obj(*torn(BODY)[:2]))
    order = np.argsort(V[:, 2])
    low, high = order[:8], order[-8:]
    ids, top = low.tolist(), V[high]
    fixed = {"name": "foot", "kind": "fixed", "vertices": ids}
    turn = rotation(2).tolist()
    handles(
        "soft.json", fixed, {"vertices": high.tolist(), "target": (top + [0.3, 0, 0.1]).tolist(), "weight": 2}
    )
    handles(
        "turned.json", fixed, {"vertices": high[:1].tolist(), "target": top[:1].tolist(), "rotation": turn}
    )
    below, above = ([[[-9, -9, z], [9, 9, z + 9]]] for z in (-10.2, 1.2))
    moved = {"name": "head", "boxes": above, "rotation": [0, 0, 0.6, 0.8], "scale": 1.1, "center": "centroid"}
    handles(
        "boxes.json",
        {"name": "floor", "kind": "fixed", "boxes": below},
        {**moved, "translation": [0.1, 0, 0.2]},
    )
    source = V[high[:3]] + 0.003
    handles("places.json", fixed, {"source": source.tolist(), "target": (source + [0, 0.2, 0]).tolist()})
    handles("still.json", fixed)
    handles(
        "saved.json",
        fixed,
        {"vertices": high.tolist(), "translation": [0.2, 0, 0]},
        made={"method": "paper", "samplings": 2},
    )
    marks, pushed = V[[*low, *high]], np.outer(np.arange(16) > 7, [0.2, 0, 0])
    for name, points in (("rest.csv", marks), ("target.csv", marks + pushed)):
        Path(name).write_text(
            "".join(f"p{k},{x!r},{y!r},{z!r}\n" for k, (x, y, z) in enumerate(points.tolist()))
        )


def unusual() -> None:
    """Write surfaces that need care, and a pose of each, with the name of the mesh."""
    two = np.vstack([V, V[:9] + 9])
    found = {
        "fin": (t_fin(4).V, t_fin(4).F),
        "band": (moebius().V, moebius().F),
        "loose": (two, np.vstack([F, F[:1], [[3, 3, 5]]])),
        "turned": (V, np.vstack([F[:9, ::-1], F[9:]])),
        "seam": tuple(torn(BODY)[:2]),
        "sheet": (strip(24, 5).V, strip(24, 5).F),
        "tiny": (1e-7 * V, F),
        "far": (V + [3e5, 0, -2e5], F),
    }
    for name, (W, G) in found.items():
        write_mesh(f"{name}.ply", np.asarray(W, float), G)
        used = np.unique(G)
        own = end_handles(
            W[used], axis=int(np.argmax(np.ptp(W[used], axis=0))), shift=0.1 * np.ptp(W[used], axis=0)
        )
        write_handles(f"{name}.json", replace(own, index=used[own.index]))


def companions() -> None:
    """Write a body, a pose, a shirt on the body and one beside it."""
    mesh = Mesh(V * 1.04, F)
    write_sound()
    write_mesh("shirt.obj", mesh.V, mesh.F)
    write_mesh("beside.ply", mesh.V + [2.0, 0, 0], mesh.F)


def poses() -> None:
    """Write a body and four poses of a walk."""
    write_mesh("body.ply", V, F)
    write_mesh("body.glb", V, F)
    for number, step in zip((1, 2, 10, 11), (0.1, 0.15, 0.6, 0.2), strict=True):
        own = pose(V)
        moved = own.target + own.dynamic[:, None] * [step, 0, 0.5 * step]
        write_handles(f"walk_{number}.json", own.at(moved), names={0: "low", 1: "high"})


def empty() -> None:
    """Write nothing."""


def meshes() -> None:
    """Write a folder of meshes in correspondence."""
    Path("meshes").mkdir()
    for k, name in enumerate(("a0", "a1", "b0", "b1", "b2")):
        write_mesh(f"meshes/{name}.ply", bent(V, 0.1 * k), F)


def formats() -> None:
    """Write a body, its files in all formats, cut to half, and files as other programs write them."""
    write_sound()
    for suffix in SUFFIXES:
        write_mesh(f"cut{suffix}", V, F)
        cut(f"cut{suffix}")
    for path in SAMPLES.iterdir():
        shutil.copy(path, ".")
    handles("all.json", {"boxes": [[[-9, -9, -9], [9, 9, 9]]], "rotation": [0, 0, 0.6, 0.8], "scale": 2})
    handles("held.json", {"vertices": [0]})


def handle_files() -> None:
    """Write a body, one with an unused vertex, two in systems, and parts and transforms of Implicit-ARAP."""
    write_sound()
    write_mesh("spare.ply", np.vstack([[[9, 9, 9]], V]), F + 1)
    for system, axes in (("LPS", [1, 1, 1]), ("RAS", [-1, -1, 1])):
        Path(f"{system.lower()}.ply").write_bytes(
            mesh_ply(V * axes, F, "", comments=[f"comment SPACE={system}"])
        )
    order = np.argsort(V[:, 2])
    parts = {"parts/foot": order[:8], "parts/hand": order[-9:], "transforms/up": order[-9:]}
    for name, ids in parts.items():
        Path(name).parent.mkdir(exist_ok=True)
        np.savetxt(f"{name}.txt", 0.8 * V[ids] / V.max() + 0.1 * (name == "transforms/up"), fmt="%.9g")
