"""Deform a case in Blender by one method: ``PYTHON -m docs.blender_runs CASE.npz METHOD OUT.npz``.

PYTHON has bpy, NumPy 1.26 and this package; :mod:`docs.blender` calls it. CASE has the arrays ``V`` (n, 3)
float32, ``F``, the handle vertices ``index``, their ``group``, and a rigid motion (4, 4) of each group in
``motions``. OUT has the positions ``U`` and the times.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import bpy
import numpy as np

import sshade.blender

#: Vertices of the proxy of Surface Deform, and iterations of Laplacian Deform.
PROXY, ITERATIONS = 6000, 5
#: Steps of the live mode: a path to the pose, and steps for the shape to come to rest.
PATH, REST = 30, 30
#: Largest number of repeats, of which the fastest counts, and seconds after which no repeat begins.
REPEATS, PATIENCE = 5, 30
Case = Mapping[str, np.ndarray]


def memory(name: str) -> float:
    """Return a size of this process, such as VmHWM, in MiB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(name))


def new_object(V: np.ndarray, F: np.ndarray, name: str = "Body") -> bpy.types.Object:
    """Return an active object with vertices V (n, 3) and triangles F (m, 3)."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(V))
    mesh.loops.add(F.size)
    mesh.polygons.add(len(F))
    mesh.attributes["position"].data.foreach_set("vector", np.asarray(V, dtype=np.float32).ravel())
    mesh.loops.foreach_set("vertex_index", F.ravel().astype(np.int32))
    mesh.polygons.foreach_set("loop_start", np.arange(0, F.size, 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(obj)
    activate(obj)
    return obj


def activate(obj: bpy.types.Object) -> None:
    """Make an object the active one."""
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)


def add_handles(obj: bpy.types.Object, case: Case) -> None:
    """Make each group of handles a vertex group and a handle with an empty, fixed where it does not move."""
    for number, motion in enumerate(case["motions"]):
        name = f"group {number}"
        own = case["index"][case["group"] == number].tolist()
        obj.vertex_groups.new(name=name).add(own, 1.0, "REPLACE")
        handle = obj.sshade.handles.add()
        handle.name = name
        if not np.array_equal(motion, np.eye(4)):
            handle.kind = "EMPTY"
            handle.empty = bpy.data.objects.new(name, None)
            bpy.context.collection.objects.link(handle.empty)
    bpy.context.view_layer.update()


def move_empties(obj: bpy.types.Object, motions: np.ndarray) -> None:
    """Place the empties, which begin at the origin."""
    from mathutils import Matrix

    for handle, motion in zip(obj.sshade.handles, motions, strict=True):
        if handle.empty is not None:
            handle.empty.matrix_world = Matrix(motion)


def part_of(motion: np.ndarray, part: float) -> np.ndarray:
    """Return a part of a rigid motion."""
    from mathutils import Matrix

    return np.array(Matrix().lerp(Matrix(motion), part)) if part < 1 else motion


def positions(obj: bpy.types.Object) -> np.ndarray:
    """Return the positions (n, 3) of an object with its modifiers and shape keys."""
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    V = np.empty((len(mesh.vertices), 3), dtype=np.float32)
    mesh.attributes["position"].data.foreach_get("vector", V.ravel())
    return V


def by_operator(case: Case, method: str) -> dict[str, Any]:
    """Deform by the extension's operator."""
    obj = new_object(case["V"], case["F"])
    add_handles(obj, case)
    move_empties(obj, case["motions"])
    obj.sshade.method = method
    begin = perf_counter()
    bpy.ops.sshade.deform()
    return {"deform": perf_counter() - begin, "U": positions(obj)}


def by_live_mode(case: Case) -> dict[str, Any]:
    """Drag the empties to the pose, in the live mode; ``step`` is the median time of a step's computation."""
    from sshade.blender import live

    obj = new_object(case["V"], case["F"])
    add_handles(obj, case)
    begin = perf_counter()
    bpy.ops.sshade.live_start()
    bind = perf_counter() - begin
    running, steps, whole = live.RUNNING[obj.session_uid], [], []
    compute = running._drag.step

    def timed(motions: Any) -> np.ndarray:
        begin = perf_counter()
        shape = compute(motions)
        steps.append(perf_counter() - begin)
        return shape

    running._drag.step = timed
    for number in range(PATH):
        begin = perf_counter()
        move_empties(obj, [part_of(motion, (number + 1) / PATH) for motion in case["motions"]])
        bpy.context.view_layer.update()
        whole.append(perf_counter() - begin)
    times = {"bind": bind, "step": float(np.median(steps)), "frame": float(np.median(whole))}
    for _ in range(REST):
        running.settle()
    U = positions(obj)
    bpy.ops.sshade.live_cancel()
    return {**times, "U": U}


def laplacian(obj: bpy.types.Object, case: Case, iterations: int) -> dict[str, Any]:
    """Deform an object by the modifier Laplacian Deform, whose anchors are the handles."""
    index = case["index"]
    obj.vertex_groups.new(name="anchors").add(index.tolist(), 1.0, "REPLACE")
    modifier = obj.modifiers.new("Laplacian", "LAPLACIANDEFORM")
    modifier.vertex_group, modifier.iterations = "anchors", iterations
    activate(obj)
    bpy.context.view_layer.update()
    begin = perf_counter()
    bpy.ops.object.laplaciandeform_bind(modifier=modifier.name)
    bpy.context.view_layer.update()
    bind = perf_counter() - begin
    if not modifier.is_bind:
        return {"failure": "the modifier does not bind"}
    begin = perf_counter()
    V = np.array(case["V"], dtype=np.float32)
    motion = case["motions"][case["group"]]
    V[index] = (np.einsum("kij,kj->ki", motion[:, :3, :3], V[index]) + motion[:, :3, 3]).astype(np.float32)
    obj.data.attributes["position"].data.foreach_set("vector", V.ravel())
    obj.data.update()
    U = positions(obj)
    if np.abs(U - V).max() == 0:
        return {"bind": bind, "failure": "the modifier leaves the mesh as it is"}
    return {"bind": bind, "deform": perf_counter() - begin, "U": U}


def by_surface(case: Case) -> dict[str, Any]:
    """Decimate the mesh, deform the small mesh by Laplacian Deform, and the mesh by Surface Deform."""
    begin = perf_counter()
    obj = new_object(case["V"], case["F"])
    small = new_object(case["V"], case["F"], "Proxy")
    modifier = small.modifiers.new("Decimate", "DECIMATE")
    modifier.ratio = PROXY / len(case["V"])
    evaluated = small.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = bpy.data.meshes.new_from_object(evaluated)
    small.modifiers.remove(modifier)
    small.data = mesh
    V = np.empty((len(mesh.vertices), 3), dtype=np.float32)
    mesh.attributes["position"].data.foreach_get("vector", V.ravel())
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(V).query(case["V"][case["index"]])
    index, first = np.unique(nearest, return_index=True)
    modifier = obj.modifiers.new("Surface", "SURFACE_DEFORM")
    modifier.target = small
    activate(obj)
    bpy.context.view_layer.update()
    bpy.ops.object.surfacedeform_bind(modifier=modifier.name)
    bpy.context.view_layer.update()
    if not modifier.is_bound:
        return {"failure": "Surface Deform does not bind"}
    coarse = {"V": V, "index": index, "group": case["group"][first], "motions": case["motions"]}
    found = laplacian(small, coarse, ITERATIONS)
    if "failure" in found:
        return found
    bind = perf_counter() - begin - found["deform"]
    begin = perf_counter()
    U = positions(obj)
    return {"bind": bind, "deform": found["deform"] + perf_counter() - begin, "U": U}


METHODS: dict[str, Callable[[Case], dict[str, Any]]] = {
    "fast": lambda case: by_operator(case, "fast"),
    "fine": lambda case: by_operator(case, "fine"),
    "live": by_live_mode,
    "laplacian": lambda case: laplacian(new_object(case["V"], case["F"]), case, ITERATIONS),
    "surface": by_surface,
}


def warm_up(method: str) -> None:
    """Load libraries and kernels by a deformation of a small mesh."""
    from docs.blender_task import tube

    V, F = tube()
    index = np.r_[np.argsort(V[:, 2])[:40], np.argsort(V[:, 2])[-40:]]
    motions = np.stack([np.eye(4), np.eye(4)])
    motions[1, 0, 3] = 0.5
    group = np.repeat([0, 1], 40)
    METHODS[method]({"V": V, "F": F, "index": index, "group": group, "motions": motions})
    clear()


def clear() -> None:
    """Remove all objects and meshes."""
    for kept in (bpy.data.objects, bpy.data.meshes):
        for one in list(kept):
            kept.remove(one)


def fastest(method: str, case: Case) -> dict[str, Any]:
    """Deform up to :data:`REPEATS` times; return the fastest result, with the peak of memory of the first."""
    begin, found, peak = perf_counter(), [], 0.0
    while len(found) < REPEATS and perf_counter() - begin < PATIENCE:
        before = memory("VmRSS")
        Path("/proc/self/clear_refs").write_text("5")  # resets the peak of memory
        found.append(METHODS[method](case))
        peak = peak or memory("VmHWM") - before
        if "failure" in found[-1]:
            return found[-1]
        clear()
    times = [sum(one.get(name, 0.0) for name in ("bind", "deform")) for one in found]
    best = found[int(np.argmin(times))]
    if "step" in best:
        best |= {name: min(one[name] for one in found) for name in ("step", "frame")}
    return {**best, "peak": peak}


def main() -> None:
    """Run a case, and write its result."""
    path, method, output = sys.argv[1:]
    sshade.blender.register()
    with np.load(path) as file:
        case = dict(file)
    if method in ("fast", "fine", "live"):
        warm_up(method)
    np.savez(output, **fastest(method, case))


if __name__ == "__main__":
    main()
