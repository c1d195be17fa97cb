"""What enters and leaves a deformation: surfaces, handles and files; how often each is computed."""

from dataclasses import replace

import numpy as np

from sshade import DeformationTask, Handles, Mesh
from sshade.files.handle_files import read_handle_file
from sshade.files.meshes import read_file, write_file, write_mesh
from sshade.files.open_shape import on_shape, open_shape
from sshade.files.task_files import write_handles
from sshade.mesh.cutting import cut_surface
from sshade.mesh.places import opening_within
from sshade.mesh.quality import NearParts, quality
from sshade.problem.snapping import snap_to_vertices
from tests.record.scenes.scene import BODY, Values, patches, scene
from tests.shapes import bent, beside, bumpy, rotation, shifted, torn, unjoined
from tests.sshade.mesh.test_cutting import moebius, t_fin

SMALL = bumpy(3)


@scene
def surfaces() -> Values:
    V, F, _ = torn(SMALL)
    for name, shape in {"seam": (V, F), "soup": (unjoined(SMALL).V, unjoined(SMALL).F)}.items():
        opened = open_shape(*shape)
        for share in (0.1, 0.3):
            yield name, opened.moved(bent(opened.mesh.V, share))
        yield name, [opened.mesh.topology, opened.extent, opening_within(opened.mesh, opened.mesh.V)]
    for mesh in (t_fin(8), moebius(), SMALL):
        yield "cut", list(cut_surface(mesh))


@scene
def measured() -> Values:
    mesh = beside(bumpy(2), shifted(bumpy(2), [1.9, 0, 0]))
    parts = NearParts(mesh)
    for amount in (0.05, 0.3):
        posed = bent(mesh.V, amount) + np.outer(mesh.component, [amount, 0, 0])
        yield "quality", [list(quality(mesh, posed)), list(parts.gap(posed) or ())]


@scene
def snapped() -> Values:
    own = patches(SMALL, 6).handles
    source = SMALL.V[own.index] + 0.01
    handles = Handles.from_positions(SMALL, source, own.target, group=own.group, weight=[2.0] * 12)
    task = DeformationTask("t", SMALL, handles)
    yield "task", [task.handles.portion, list(task.handles.snapping)]
    yield "again", replace(task, guess=SMALL.V).handles.portion
    yield "snapped", list(snap_to_vertices(BODY, source, own.group))


@scene
def stored() -> Values:
    V, F, seam = torn(SMALL)
    posed = V @ rotation(3).T
    own = Handles(seam[:5], V[seam[:5]] + 1, weight=2.0)
    write_handles("pose.json", own)
    for suffix in (".ply", ".obj", ".off", ".stl", ".glb"):
        write_mesh(f"a{suffix}", V, F)
        file = read_file(f"a{suffix}")
        write_file(f"b{suffix}", file, posed[F].reshape(-1, 3) if suffix == ".stl" else posed)
        yield suffix, Mesh(*map(np.array, (file.V, file.F))) if suffix == ".stl" else file.F
        if suffix == ".ply":
            yield "placed", on_shape(read_handle_file("pose.json"), open_shape(file))
