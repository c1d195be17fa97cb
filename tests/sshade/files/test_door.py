"""Shapes of every kind become a surface through one door, and their positions go back."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from sshade import Handles, InputError, Mesh
from sshade.files.door import open_shape
from sshade.files.meshes import read_file
from tests.shapes import bumpy, torn
from tests.write import mesh_ply

BODY = bumpy(2)
#: A body with a seam and a vertex in no face.
V, F, SEAM = torn(BODY)


@pytest.mark.parametrize("kind", ["arrays", "an object", "a file"])
def test_every_kind_of_shape_gives_the_same_surface_and_takes_positions_back(here, kind):
    if kind == "arrays":
        shape = open_shape(V, F)
    elif kind == "an object":
        shape = open_shape(trimesh.Trimesh(V, F, process=False))
    else:
        Path("rest.ply").write_bytes(mesh_ply(V, F))
        shape = open_shape(read_file("rest.ply"))
    assert shape.mesh.n == BODY.n and np.array_equal(shape.mesh.V, BODY.V)
    moved = shape.moved(shape.mesh.V + [0, 0, 1])
    moved = moved.vertices if kind == "an object" else moved
    assert np.array_equal(moved[0], V[0]) and np.array_equal(moved[1:], V[1:] + [0, 0, 1])
    assert np.array_equal(V[0], [9, 9, 9]), "the shape itself stays"


def test_a_task_has_handles_of_the_shape_at_vertices_of_the_surface():
    shape, copies = open_shape(V, F), np.flatnonzero((V[SEAM[0]] == V).all(axis=1))
    assert len(copies) == 2
    handles = shape.on_surface(Handles(copies, V[copies] + [0, 0, 1], group=[4, 4]))
    task = shape.task("lift", handles)
    assert (task.name, task.mesh) == ("lift", shape.mesh) and not task.refuse_unconstrained
    assert np.array_equal(task.mesh.V[task.handles.index], V[copies[:1]])
    with pytest.raises(InputError, match="belongs to no face"):
        shape.on_surface(Handles([0], V[[0]]))


def test_a_result_is_a_copy_also_if_it_is_the_shape_itself():
    for shape in (open_shape(BODY.V, BODY.F), open_shape(Mesh(BODY.V, BODY.F))):
        moved = shape.moved(shape.mesh.V)
        moved = moved.V if isinstance(moved, Mesh) else moved
        assert np.array_equal(moved, BODY.V) and not np.shares_memory(moved, BODY.V)


def test_what_is_no_shape_is_refused(here):
    with pytest.raises(InputError, match="no mesh in an object of type SimpleNamespace"):
        open_shape(SimpleNamespace(vertices=V))
    Path("points.ply").write_bytes(mesh_ply(V, []))
    with pytest.raises(InputError, match="^the file holds no triangles; give a mesh with faces"):
        open_shape(read_file("points.ply"))
