"""Files with which transcripts begin."""

import json
import os
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from eval.rows.frame import write_csv
from sshade import Handles, Mesh
from sshade.files.mesh_file import SUFFIXES
from sshade.files.meshes import read_arrays, write_mesh
from sshade.files.task_files import write_handles
from tests.defaust.registrations import write_faust
from tests.defaust.test_sequence import write_class
from tests.eval import eval_rows
from tests.files import SAMPLES
from tests.robustness.case import run
from tests.robustness.inputs import BODY, pose, write_sound
from tests.robustness.working import cut
from tests.robustness.working import runs as runs
from tests.shapes import (
    as_obj,
    bent,
    beside,
    block,
    bumpy,
    end_handles,
    icosphere,
    jittered,
    rotation,
    shifted,
    strip,
    torn,
    torus,
    tube,
    upwards,
)
from tests.sshade.mesh.test_cutting import moebius, t_fin
from tests.write import lines, mesh_ply, obj, rows

V, F = BODY.V, BODY.F


def handles(name: str, *entries: dict, **more) -> None:
    """Write a handle file of entries."""
    Path(name).write_text(json.dumps({"handles": list(entries), **more}))


def bodies() -> None:
    """Write a body, poses of it with handles of all kinds, the bent body, and the body as other files."""
    write_sound()
    write_mesh("bent.ply", bent(V), F)
    write_mesh("grown.ply", V * [1.1, 1, 1], F)
    seam, faces, _ = torn(BODY)
    Path("seam.obj").write_text(as_obj(seam, faces))
    write_mesh("seam_bent.ply", bent(seam), faces)
    write_mesh("aside.ply", V * [1.02, 1, 1] + [9, 0, 0], F)
    order = upwards(V)
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


def refused() -> None:
    """Write files that are not what commands take them for."""
    write_sound()
    for name in ("pose.txt", "pose.abc", "body.abc", "edited.ply", "rest.mrk.json"):
        Path(name).touch()
    Path("syntax.json").write_text('{"handles": [')
    for name, made in {"quick": {"method": "quick"}, "typo": {"methd": 0}, "weld": {"weld": -1}}.items():
        handles(f"{name}.json", {"vertices": [1]}, made=made)
    for folder in ("folder", "folder.ply"):
        Path(folder).mkdir()
    os.mkfifo("pipe.ply")
    Path("null.ply").symlink_to("/dev/null")


def unlike() -> None:
    """Write shapes, proxies, handles and maps that do not belong together."""
    nan = np.where(np.arange(len(V))[:, None] == 3, np.nan, V)
    for name, U in {"body": V, "body_1": V, "far": V + 100, "nan": nan, "posed": bent(V)}.items():
        write_mesh(f"{name}.ply", U, F)
    write_mesh("turned.ply", V, F[::-1])
    write_mesh("small.ply", bumpy(0).V, bumpy(0).F)
    write_mesh("aside.ply", V + [9, 0, 0], F)
    for space in ("LPS", "RAS"):
        Path(f"{space}.obj").write_bytes(lines([f"# SPACE={space}"]) + obj(V + [9, 0, 0], F))
    write_handles("pose.json", Handles([1], V[[1]]))
    write_handles("two.json", Handles([1, 2], V[[1, 2]], group=[0, 1]))
    held = {"kind": "fixed", "vertices": [0]}
    handles("pushed.json", held, {"vertices": [5, 6, 7], "translation": [0, 2000, 0]})
    handles("grown.json", held, {"vertices": [5, 6, 7], "scale": 1000})
    np.savetxt("rest.csv", V[:9], delimiter=",")
    np.savetxt("mm.csv", 1000 * V[:9], delimiter=",")
    marks = [
        {"label": f"p{k}", "position": U.tolist()} for k, U in enumerate((V[:5] + [9, 0, 0]) * [-1, -1, 1])
    ]
    system = {"coordinateSystem": "RAS", "controlPoints": marks}
    Path("marks.mrk.json").write_text(json.dumps({"markups": [system]}))
    run("sshade remesh body.ply -o proxy.ply --map map.npz --vertices 40")
    W, G = read_arrays("proxy.ply")
    order = np.random.default_rng(0).permutation(len(W))
    write_mesh("sorted.ply", W[order], np.argsort(order)[G])
    write_mesh("same_edges.ply", W, np.roll(G, 1, axis=1)[::-1])
    write_mesh("missing.ply", np.where(np.arange(len(W))[:, None] == 0, np.nan, W), G)
    W[G[0, 1]] = W[G[0, 0]]
    write_mesh("flat.ply", W, G)
    Path("damaged.ply").write_text("ply\n")
    Path("damaged.npz").write_bytes(Path("map.npz").read_bytes()[:-100])


def told() -> None:
    """Write meshes and handles about which there is something to say."""
    write_sound()
    flat, whole = V.copy(), pose(V)
    flat[F[100, 1]] = flat[F[100, 0]]
    write_mesh("flat.ply", flat, F)
    write_mesh("two.ply", np.vstack([V, V + 9]), np.vstack([F, F + len(V)]))
    handles("free.json", {"vertices": [0, 9], "translation": [0.3, 0.3, 0.3]})
    source, apart = V[whole.index[[-1, -1]]] + [[0.01, 0, 0], [-0.01, 0, 0]], [[0, 0.01, 0], [0, -0.01, 0]]
    turn = {"vertices": whole.index[:1].tolist(), "kind": "dynamic", "rotation": rotation(2).tolist()}
    handles("merged.json", {"source": source.tolist(), "target": (source + apart).tolist()}, turn)
    cube = block(np.ones((1, 1, 1)))
    write_mesh("long.ply", cube.V * [1, 1, 6], cube.F)
    write_handles("long.json", end_handles(cube.V * [1, 1, 6]))
    solid = beside(*(shifted(cube, corner) for corner in np.argwhere(np.ones((4, 4, 4)))))
    corners, number = np.unique(solid.V, axis=0, return_inverse=True)
    write_mesh("solid.ply", corners, number.ravel()[solid.F])
    handles("solid.json", {"vertices": [0, 60]}, {"vertices": [124], "scale": 2})
    ball = icosphere(3)
    write_mesh("ball.ply", np.vstack([[[9, 9, 9]], ball.V]), ball.F + 1)
    for name, every in {"dense": 2, "shuffled": 5}.items():
        ids = np.arange(0, ball.n, every)
        target = ball.V[ids] + 0.1 * np.sin(2 * ball.V[ids, ::-1])
        if name == "shuffled":
            target[:80:4] = np.roll(target[:80:4], 1, axis=0)
        write_handles(f"{name}.json", Handles(ids + 1, target))
    part, names = tube(12, 8, length=2.0), ("foot", "leg", "seat", "back", "head")
    chain = jittered(beside(*(shifted(part, [0, 0, 1.7 * k]) for k in range(5))), 0.02)
    write_mesh("chain.ply", chain.V, chain.F)
    groups = [[f"g {name}", *rows("f ", part.F + 1 + k * part.n)] for k, name in enumerate(names)]
    Path("chain.obj").write_bytes(lines(rows("v ", chain.V), *groups))
    ends = ({"name": f"side {k}", "vertices": [96 * k, 96 * k + 9]} for k in range(5))
    handles("several.json", *({**one, "translation": [k % 2, 0, 0]} for k, one in enumerate(ends)))
    low = {"name": "low", "kind": "fixed", "vertices": list(range(12))}
    for name, shift in {"wide": 3.0, "narrow": 0.01}.items():
        high = {"name": "high", "vertices": list(range(chain.n - 12, chain.n))}
        handles(f"{name}.json", low, {**high, "translation": [shift, 0, 0]})


def companions() -> None:
    """Write a body, a pose, clothes on the body and beside it, and all of it in millimetres."""
    mesh = Mesh(V * 1.04, F)
    write_sound()
    write_mesh("shirt.obj", mesh.V, mesh.F)
    write_mesh("hair.glb", mesh.V, mesh.F)
    write_mesh("beside.ply", mesh.V + [2.0, 0, 0], mesh.F)
    faces = [f"f {a}/1/{i} {b}/1/{i} {c}/1/{i}" for i, (a, b, c) in enumerate((F + 1).tolist(), 1)]
    head = ["mtllib cloth.mtl", "usemtl cloth", "vt 0.1 0.2"]
    parts = head, rows("v ", mesh.V), rows("vn ", mesh.face_normals), faces
    Path("cloth.obj").write_bytes(lines(*parts))
    write_mesh("large.ply", 1000 * V, F)
    write_handles("large.json", pose(1000 * V))
    write_mesh("large_shirt.ply", 1000 * mesh.V + [5, 0, 0], F)
    write_mesh("large_beside.ply", 1000 * mesh.V + [0, 0, -2000], F)


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
    order = upwards(V)
    parts = {"parts/foot": order[:8], "parts/hand": order[-9:], "transforms/up": order[-9:]}
    for name, ids in parts.items():
        Path(name).parent.mkdir(exist_ok=True)
        np.savetxt(f"{name}.txt", 0.8 * V[ids] / V.max() + 0.1 * (name == "transforms/up"), fmt="%.9g")


def sources() -> None:
    """Write two classes of meshes, and two poses of a body in FAUST's layout."""
    write_class(Path("classes"), "cat", icosphere(1))
    write_class(Path("classes"), "dog", torus())
    write_faust(Path("faust"), poses=(0, 1))


def published() -> None:
    """Write rows of experiments, and those that are published already."""
    row = partial(eval_rows.row, env__commit="1")
    old = [row("a"), row("b"), row("c"), row("c", "t2"), row("d")]
    seeds = [row(name, task, seed=seed) for name in "ab" for task in ("t1", "t2") for seed in (0, 1)]
    seeds[1] = eval_rows.lost("a") | {"seed": 1}
    new = [row("a", date="2026-01-02", iterations=1.0), row("b", date="2025-01-01", iterations=2.0)]
    again = [row("a", task, method__hash="other", iterations=5.0) for task in ("t1", "t2")]
    newer = [row("c", task, method__version=2, iterations=3.0) for task in ("t1", "t2")]
    for name, published, own in (
        ("tiny", [row("early")], [row("arap"), row("paper")]),
        ("mixed", [], [row("a"), again[1]]),
        ("lacking", old, [*new, newer[0]]),
        ("newer", old, [*new, *newer]),
        ("half_again", [row("a"), row("a", "t2"), row("b")], again[:1]),
        ("again", [row("a"), row("a", "t2"), row("b")], again),
        ("modified", [], [row("a"), row("b", env__modified=True)]),
        ("no_commit", [], [row("a", env__commit=None)]),
        ("own", [], [row("a"), row("b", method__target="mine.method")]),
        ("own_proxy", [], [row("b", method__proxy_method__target="mine.own")]),
        ("program", [], [row("p", method__command="[mine]")]),
        ("measures", [row("a")], [row("b", measures=2)]),
        ("seeds", [], seeds),
        ("no_status", [], [row("a", status="fine")]),
        ("no_date", [], [row("a", date="")]),
        ("no_number", [], [row("a", metric__edge="small")]),
    ):
        for folder, these in (("results", published), ("out", own)):
            if these:
                write_csv(f"{folder}/rows/{name}.csv", eval_rows.frame(*these))
    for name in ("tiny.png", "tiny_time.svg", "other.png"):
        Path("out/figures").mkdir(exist_ok=True)
        Path("out/figures", name).write_text("a picture")
