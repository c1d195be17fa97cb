import re
from inspect import getdoc, getmodule
from pathlib import Path

import igl
import numpy as np
import pytest
import yaml
from hydra.utils import get_method
from scipy.interpolate import RBFInterpolator
from scipy.spatial.transform import Rotation

from baselines.accelerated import local_global
from baselines.arap import libigl_arap
from baselines.deformation_fields import deformation_field
from baselines.rbf import rbf
from baselines.smooth_arap import smooth_arap
from baselines.volumetric.lattice import lattice
from baselines.volumetric.lattice_arap import lattice_arap
from sshade import DeformationTask, Handles, InputError, Mesh
from sshade.solver.laplacian import edge_weights, half_cotangents, laplacian_matrix
from tests.shapes import block, bumpy, folded, held_ends, icosphere, jittered, rotation, strip, tube

SPOKES = "ARAP_ENERGY_TYPE_SPOKES"
ENERGIES = {"spokes": SPOKES, "spokes_and_rims": f"{SPOKES}_AND_RIMS"}


@pytest.fixture(scope="module")
def task() -> DeformationTask:
    """The lower end of a body held, the upper end turned and lifted."""
    return held_ends(bumpy(2), turn=Rotation.from_euler("y", 50, degrees=True).as_matrix())


def igl_positions(task: DeformationTask, energy: str, iterations: int, start: np.ndarray) -> np.ndarray:
    data = igl.ARAPData()
    data.energy, data.max_iter = getattr(igl.ARAPEnergyType, ENERGIES[energy]), iterations
    V, F = np.array(task.mesh.V), np.array(task.mesh.F)
    igl.arap_precomputation(V, F, 3, np.array(task.handles.index), data)
    return igl.arap_solve(np.array(task.handles.target), data, start)


@pytest.mark.parametrize("energy", ENERGIES)
@pytest.mark.parametrize("iterations", [7, 40])
def test_iterations_one_a_call_equal_one_libigl_call_bit_for_bit(task, energy, iterations):
    result = libigl_arap(task, energy=energy, tolerance=0, max_iterations=iterations)
    start = task.mesh.V.copy()
    start[task.handles.index] = task.handles.target
    assert np.array_equal(result.vertices, igl_positions(task, energy, iterations, start))
    assert result.iterations == iterations and result.converged is False
    before = igl_positions(task, energy, iterations - 1, start)
    moved = np.linalg.norm(result.vertices - before, axis=1).max() / task.mesh.diagonal
    assert result.extra["residual"] == pytest.approx(moved)


# --- radial basis functions against SciPy's own call


@pytest.mark.parametrize("kernel", ["thin_plate_spline", "cubic"])
def test_it_is_the_spline_of_scipy_through_the_nearest_handles(kernel, monkeypatch):
    monkeypatch.setattr("baselines.rbf.BLOCK", 100)
    told, mesh, rng = [], bumpy(2), np.random.default_rng(6)
    index = rng.choice(mesh.n, 20, replace=False)
    task = DeformationTask("dense", mesh, Handles(index, mesh.V[index] + rng.normal(size=(20, 3))))
    found = rbf(task, neighbours=12, kernel=kernel, progress=lambda *words: told.append(words)).vertices
    expected = RBFInterpolator(mesh.V[index], task.handles.target, neighbors=12, kernel=kernel)(mesh.V)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert np.array_equal(found[index], task.handles.target)
    assert told == [("vertices", done, 162) for done in (0, 100, 162)]
    with pytest.raises(InputError, match="^rbf: "):
        rbf(DeformationTask("few", mesh, Handles(index[:3], mesh.V[index[:3]])))


# --- harmonic and biharmonic fields against dense solutions and closed forms


@pytest.mark.parametrize("order", [1, 2])
def test_the_field_solves_its_equation(order):
    task = held_ends(bumpy(2))
    mesh, handles = task.mesh, task.handles
    L = laplacian_matrix(mesh.n, *edge_weights(mesh, half_cotangents(mesh))).toarray()
    if order == 2:
        areas = igl.massmatrix(np.array(mesh.V), np.array(mesh.F), igl.MASSMATRIX_TYPE_VORONOI).diagonal()
        L = L @ (L / areas[:, None])
    free = np.setdiff1d(np.arange(mesh.n), handles.index)
    d = np.zeros((mesh.n, 3))
    d[handles.index] = handles.target - mesh.V[handles.index]
    d[free] = np.linalg.solve(L[np.ix_(free, free)], -L[np.ix_(free, handles.index)] @ d[handles.index])
    result = deformation_field(task, order=order)
    assert np.abs(result.vertices - (mesh.V + d)).max() < 1e-10 * mesh.diagonal


# --- smooth ARAP against results of its authors' program, and against ARAP

ORACLES = sorted(Path(__file__).parent.glob("oracles/smooth_arap_*.npz"))


@pytest.mark.parametrize("path", ORACLES, ids=lambda path: path.stem)
def test_converges_to_the_result_of_the_authors_program(path):
    with np.load(path) as file:
        mesh, handles = Mesh(file["V"], file["F"].astype(int)), Handles(file["handles"], file["targets"])
        smoothness, expected = float(file["smoothness"]), file["converged"]
    ours = smooth_arap(DeformationTask("oracle", mesh, handles), smoothness=smoothness, tolerance=1e-10)
    assert ours.converged
    assert np.abs(ours.vertices - expected).max() < 1e-6 * mesh.diagonal


def test_without_smoothness_it_is_arap_with_spokes_and_rims():
    task = held_ends(bumpy(2))
    assert (smooth_arap(task, max_iterations=0).extra["rotations"] == np.eye(3)).all()
    task = DeformationTask("guess", task.mesh, task.handles, guess=task.mesh.V)  # rotations are fitted first
    ours = smooth_arap(task, smoothness=0.0, tolerance=0, max_iterations=25)
    arap = local_global(task, accelerate=False, tolerance=0, max_iterations=25)
    assert np.abs(ours.vertices - arap.vertices).max() < 1e-11 * task.mesh.diagonal


# --- lattices around surfaces of any kind, and ARAP on them

SURFACES = {"closed": bumpy(2), "open": tube(), "sheet": jittered(strip(12, 6), 0.1), "folded": folded(40, 8)}
SURFACES["not manifold"] = block(np.array([[[1], [0]], [[0], [1]]]), cells=3)


def test_a_filled_lattice_has_the_volume_of_the_shape():
    mesh = icosphere(3)
    side = mesh.diagonal / 30
    shell, full = (len(lattice(mesh, cells=30, filled=filled).cubes) for filled in (False, True))
    assert shell * side**3 < 0.8 * mesh.volume < mesh.volume < full * side**3 < 1.5 * mesh.volume


@pytest.mark.parametrize("mesh", SURFACES.values(), ids=SURFACES)
def test_lattice_arap_reproduces_rigid_motions_of_any_surface(mesh):
    index = np.argsort(mesh.V[:, 0] + 0.1 * mesh.V[:, 1])[[0, 1, 2, 3, -4, -3, -2, -1]]
    expected = mesh.V @ rotation(2).T + [3.0, 0, -1]
    task = DeformationTask("rigid", mesh, Handles(index, expected[index]))
    result = lattice_arap(task, cells=14, start="rigid")
    assert result.converged
    assert np.abs(result.vertices - expected).max() < 1e-9 * mesh.diagonal


def test_lattice_arap_is_stationary_where_it_stops():
    task = held_ends(bumpy(2))
    options = {"cells": 10, "tolerance": 1e-10, "max_iterations": 5000}
    first, second = (lattice_arap(task, **options, start=start) for start in ("rest", "rigid"))
    assert first.converged and second.converged
    assert np.abs(first.vertices - second.vertices).max() < 1e-6 * task.mesh.diagonal
    assert first.extra["handle_before"] < 5e-3


# --- each baseline names its proof: libigl's own call, its authors' program, a closed form, or formulas

ROOT = Path(__file__).parents[2]
TARGETS = {
    target
    for path in (ROOT / "conf/method").rglob("*.yaml")
    if (target := yaml.safe_load(path.read_text("utf-8")).get("_target_", "")).startswith("baselines.")
}


@pytest.mark.parametrize("target", sorted(TARGETS))
def test_a_baseline_names_its_proof_and_the_file_of_its_test(target):
    method = get_method(target)
    text = f"{getdoc(method)}\n{getdoc(getmodule(method))}"
    (proof,) = re.findall(r"^Proof: (.+?)(?:\n\n|\Z)", text, flags=re.MULTILINE | re.DOTALL)
    tests = re.findall(r"tests/\S+\.py", proof)
    assert tests and all((ROOT / path).is_file() for path in tests)
