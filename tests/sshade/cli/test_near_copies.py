"""Closed meshes whose files store vertices several times, with rounding noise, stay closed."""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import pyvista
import trimesh

from sshade import Mesh, deform
from sshade.cli.main import main
from sshade.files.meshes import read_arrays
from sshade.files.objects import opened
from tests.shapes import beside, block, bumpy, double_torus, icosphere, shifted, torus
from tests.write import mesh_ply, obj

SHAPES = {
    "sphere": bumpy(2),
    "torus": torus(16, 8),
    "cube": block(np.ones((1, 1, 1), dtype=bool), cells=4),
    "two": beside(icosphere(2), shifted(icosphere(1), [0.2, 4.0, 0.5])),
    "genus 2": double_torus(cells=1),
    "far": shifted(bumpy(2), [40.0, -3.0, 1.0]),
    "tiny": Mesh(1e-5 * torus(12, 6).V, torus(12, 6).F),
}


def split(V: np.ndarray, F: np.ndarray, share: float, rng) -> tuple[np.ndarray, np.ndarray]:
    """Give some corners a copy of their vertex."""
    chosen = rng.random(F.shape) < share
    G = F.copy()
    G[chosen] = len(V) + np.arange(chosen.sum())
    W = np.concatenate([V, V[F[chosen]]])
    used = np.unique(G)
    return W[used], np.searchsorted(used, G)


def shuffled(V: np.ndarray, F: np.ndarray, rng) -> tuple[np.ndarray, np.ndarray]:
    """Change the order of vertices and faces, and the first corners of faces."""
    order = rng.permutation(len(V))
    F = np.argsort(order)[F[rng.permutation(len(F))]]
    turn = (np.arange(3) + rng.integers(3, size=(len(F), 1))) % 3
    return V[order], np.take_along_axis(F, turn, axis=1)


def written(name: str, V: np.ndarray, F: np.ndarray) -> bytes:
    """Return the content of a file with all vertices."""
    kind = Path(name).suffix[1:]
    if kind == "ply":
        return mesh_ply(V, F, kind=Path(name).stem)
    return obj(V, F) if kind == "obj" else trimesh.Trimesh(V, F, process=False).export(file_type=kind)


def noisy(mesh: Mesh, *, whole: bool, single: bool, rng) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, faces, and the vertex of `mesh` for each vertex: split, with noise, shuffled, turned."""
    numbered = np.column_stack([mesh.V, np.arange(mesh.n)])
    share = 1.0 if whole else rng.choice([0.1, 0.5, 0.9])
    V, F = shuffled(*split(numbered, mesh.F, share, rng), rng)
    V, origin = V[:, :3], V[:, 3].astype(np.int64)
    if single:
        steps = np.spacing(np.abs(V).max(axis=0).astype(np.float32))
        V = V.astype(np.float32) + steps * rng.integers(-2, 3, V.shape).astype(np.float32)
    else:
        V = V + rng.uniform(-1e-9, 1e-9, V.shape) * mesh.diagonal
    turned = rng.random(mesh.m) < rng.choice([0.0, 0.3])
    return V.astype(np.float64), np.where(turned[:, None], F[:, ::-1], F), origin


@pytest.mark.parametrize(
    ("shape", "name"),
    [
        *product(SHAPES, ("soup.stl", "float.ply")),
        *product(["sphere"], ("double.ply", "mesh.obj", "mesh.glb")),
    ],
)
def test_split_and_noisy_vertices_stay_together(here, shape, name):
    mesh, single = SHAPES[shape], name in ("soup.stl", "float.ply", "mesh.glb")
    rng = np.random.default_rng(sum(map(ord, shape + name)))
    V, F, origin = noisy(mesh, whole=name.endswith(".stl"), single=single, rng=rng)
    Path(name).write_bytes(written(name, V, F))
    low, high = mesh.V.min(axis=0) - 0.01 * mesh.diagonal, mesh.V.max(axis=0) + 0.01 * mesh.diagonal
    third = (high[1] - low[1]) / 3
    down = {"boxes": [[low.tolist(), [high[0], low[1] + third, high[2]]]]}
    up = {"boxes": [[[low[0], high[1] - third, low[2]], high.tolist()]]}
    up["translation"] = (0.1 * (high - low)).tolist()
    Path("pose.json").write_text(json.dumps({"handles": [down, up]}))
    rest = read_arrays(name)[0]
    origin = origin[F.ravel()] if name.endswith(".stl") else origin
    assert len(V) > mesh.n and np.ptp([rest[origin == i][[0, -1]] for i in range(mesh.n)], axis=1).any()
    for options in ("fast --repair", "fast", "fine", "paper"):
        out = "out" + Path(name).suffix
        command = f"deform {name} pose.json -o {out} --carry-unconstrained --vertices 120 --method {options}"
        assert main(command.split()) == 0
        moved = read_arrays(out)[0]
        assert_together(moved, origin)
        assert np.abs(moved - rest).max() > 0.05 * np.ptp(mesh.V[:, 1])


@pytest.mark.parametrize(
    "made",
    [
        lambda V, F: (V, F),
        lambda V, F: (trimesh.Trimesh(V, F, process=False),),
        lambda V, F: (pyvista.PolyData.from_regular_faces(V, F),),
    ],
)
def test_python_joins_the_copies_too(made):
    mesh = SHAPES["sphere"]
    V, F, origin = noisy(mesh, whole=True, single=True, rng=np.random.default_rng(5))
    b = np.array([np.argmax(V[:, 2]), np.argmin(V[:, 2])])
    moved = deform(*made(V.astype(np.float32), F), b, V[b] * 1.2, vertices=60)
    assert_together(np.asarray(opened(moved).V if opened(moved) else moved), origin)


def assert_together(moved: np.ndarray, origin: np.ndarray) -> None:
    """All copies of a vertex, whose number is `origin` (n,), are exactly at one place."""
    place = np.full((origin.max() + 1, 3), np.nan)
    place[origin] = moved
    assert np.array_equal(moved, place[origin]), "copies of a vertex come apart"
