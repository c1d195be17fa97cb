"""Implicit-ARAP: networks, distances, patches, energy, and small runs."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra torch is not installed")

import igl  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

from baselines.implicit_arap import implicit_arap  # noqa: E402
from baselines.implicit_arap.networks import (  # noqa: E402
    Mlp,
    MotionField,
    euler_rotation,
)
from baselines.implicit_arap.patches import (  # noqa: E402
    patches_at,
    pattern_of,
    random_pattern,
    zero_set,
)
from baselines.implicit_arap.sdf import GridSdf, ImplicitSurface, fit_network_sdf  # noqa: E402
from baselines.implicit_arap.training import HandleConstraints  # noqa: E402
from sshade.problem.task import DeformationTask, Handles, silent  # noqa: E402
from tests.shapes import bumpy, held_ends, icosphere  # noqa: E402

CPU = torch.device("cpu")
SMALL = {"sdf": "grid", "grid_size": 32, "width": 48, "layers": 3, "steps": 60, "device": "cpu"}
SMALL |= {"surface_patches": 80, "space_patches": 40, "patch_points": 12, "projections": 2}


class Ball:
    """The exact signed distance to a sphere about the origin."""

    def __init__(self, radius: float = 0.6) -> None:
        self.radius = radius

    def __call__(self, x):
        return x.norm(dim=-1) - self.radius

    def with_gradient(self, x):
        return self(x), torch.nn.functional.normalize(x, dim=-1)


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def points(count=200, seed=1):
    return 2 * torch.rand(count, 3, generator=generator(seed)) - 1


def twist():
    """A task on an icosphere: the lower cap stays, the upper cap turns by 40 degrees about z and rises."""
    return held_ends(icosphere(3), share=0.1, turn=Rotation.from_euler("z", 40, degrees=True).as_matrix())


@pytest.fixture(scope="module")
def twisted():
    return implicit_arap(twist(), seed=4, **SMALL)


# Networks


def test_euler_angles_compose_x_then_y_then_z():
    angles = 6 * torch.rand(50, 3, generator=generator(), dtype=torch.float64) - 3
    expected = Rotation.from_euler("XYZ", angles.numpy()).as_matrix()
    np.testing.assert_allclose(euler_rotation(angles).numpy(), expected, atol=1e-12)


def test_published_networks_have_the_published_sizes():
    def count(network):
        return sum(parameter.numel() for parameter in network.parameters())

    sizes = {"width": 256, "layers": 8, "frequencies": 6, "generator": generator()}
    # Seven hidden layers of 256 with weight norm; layer 4 gets the 39 features again.
    hidden = 256 * (39 + 6 * 256 + 39 + 7 + 7)
    assert count(MotionField(**sizes)) == hidden + 6 * 257
    assert count(Mlp(3, 1, last="sphere", **sizes)) == hidden + 256 + 2


# Distances


def test_grid_reproduces_a_linear_function_with_its_axes_in_order():
    axis = np.linspace(-1, 1, 9)
    X, Y, Z = np.meshgrid(axis, axis, axis, indexing="ij")
    sdf, x = GridSdf(0.1 + X - 2 * Y + 3 * Z, device=CPU), points()
    f, gradient = sdf.with_gradient(x)
    torch.testing.assert_close(f, 0.1 + x @ torch.tensor([1.0, -2.0, 3.0]), atol=1e-5, rtol=0)
    torch.testing.assert_close(gradient, torch.tensor([[1.0, -2.0, 3.0]]).expand(200, 3), atol=1e-4, rtol=0)


def test_fitted_network_approaches_the_distance():
    sphere = icosphere(3)
    surface = ImplicitSurface.of(0.7 * sphere.V, sphere.F, device=CPU)
    settings = {"width": 32, "layers": 4, "frequencies": 2, "points": 256, "learning_rate": 1e-3}
    x = 0.7 * torch.nn.functional.normalize(points(300), dim=-1)

    def off_surface(steps):
        sdf, loss = fit_network_sdf(
            surface, steps=steps, generator=generator(), weights=generator(), progress=silent, **settings
        )
        assert np.isfinite(loss)
        return sdf, sdf(x).abs().mean()

    (_, before), (sdf, after) = off_surface(1), off_surface(150)
    assert after < 0.04 < 0.2 < before
    _, gradient = sdf.with_gradient(x)
    assert torch.nn.functional.cosine_similarity(gradient, x, dim=-1).mean() > 0.9


def test_surface_samples_lie_on_faces_in_proportion_to_area():
    mesh = bumpy(2)
    x, normal = ImplicitSurface.of(mesh.V, mesh.F, device=CPU).sample(20_000, generator())
    squared, face, _ = igl.point_mesh_squared_distance(x.double().numpy(), mesh.V, np.array(mesh.F))
    assert squared.max() < 1e-10
    share = np.bincount(face, minlength=mesh.m) / 20_000
    assert np.abs(share - mesh.face_areas / mesh.area).max() < 0.004
    assert (np.einsum("ij,ij->i", mesh.face_normals[face], normal.numpy()) > 0.999).mean() > 0.99


# Patches


def test_correct_weights_are_those_of_libigl():
    pattern = random_pattern(30, 0.03, np.random.default_rng(5))
    flat = torch.nn.functional.pad(pattern.points, (0, 1))
    weights = pattern.weights(flat[None])[0].double().numpy()
    V, F = flat.double().numpy(), pattern.triangles.numpy()
    cotangents = 2 * igl.cotmatrix(V, F)  # igl halves them
    source, target = (part.argmax(dim=1).numpy() for part in (pattern.source, -pattern.difference))
    expected = np.asarray(cotangents.todense())[source, target]
    assert len(expected) == 2 * len(igl.edges(F))
    assert igl.doublearea(V, F).min() > 2e-6  # below 2e-6, weights are limited
    np.testing.assert_allclose(weights, expected, rtol=1e-3, atol=1e-3)


def test_patches_lie_on_the_level_set_of_their_centre():
    sdf, centres = Ball(), points(100)
    centres = centres[centres.norm(dim=-1) > 0.1]
    pattern = random_pattern(12, 0.03, np.random.default_rng(0))
    patches = patches_at(sdf, centres, pattern, repeats=5)
    torch.testing.assert_close(patches[:, 0], centres, atol=1e-6, rtol=0)
    levels = sdf(patches.flatten(0, 1)).unflatten(0, patches.shape[:2])
    torch.testing.assert_close(levels, sdf(centres)[:, None].expand_as(levels), atol=1e-6, rtol=0)
    # Patches keep the orientation of the pattern: the normals of their triangles point outwards.
    a, b, c = patches[:, pattern.triangles].unbind(2)
    outwards = (torch.linalg.cross(b - a, c - a) * a).sum(dim=-1)
    assert (outwards > 0).float().mean() > 0.99


def test_a_field_without_surface_is_an_error(monkeypatch):
    monkeypatch.setattr("baselines.implicit_arap.patches.DRAWS", 2)
    with pytest.raises(RuntimeError, match="sdf=grid"):
        zero_set(Ball(9.0), 5, repeats=1, generator=generator())


def test_energy_of_a_stretch_by_hand():
    """Stretch a unit square by 1.5 along x, with R = 1. Its sides along x have weight 1 and count twice."""
    pattern = pattern_of(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]), np.array([[0, 1, 2], [0, 2, 3]]))
    flat = torch.nn.functional.pad(pattern.points, (0, 1))[None]
    eye = torch.eye(3).expand(*flat.shape, 3)
    energy = pattern.energy(flat, eye, flat * torch.tensor([1.5, 1, 1]))
    assert energy.item() == pytest.approx(2 * 2 * 0.5**2)


# Training


def test_static_handles_stay_at_their_projections_and_moving_ones_come_first():
    rest, target = points(4, seed=2), points(4, seed=3)
    dynamic = np.array([False, True, False, True])
    at, goal, moving = HandleConstraints.of(Ball(), rest, target, dynamic, repeats=2)
    projected = 0.6 * torch.nn.functional.normalize(rest, dim=-1)
    assert moving == 2
    torch.testing.assert_close(at, projected[[1, 3, 0, 2]])
    torch.testing.assert_close(goal, torch.cat([target[[1, 3]], projected[[0, 2]]]))


def test_a_small_run_lowers_the_loss_and_meets_the_handles(twisted):
    extra, diagonal = twisted.extra, icosphere(3).diagonal
    first, *_, last = extra["loss_curve"].sum(axis=1)
    assert last < first / 10
    assert extra["handle_error"] < 0.02
    task = twist()
    gap = np.linalg.norm(twisted.vertices[task.handles.index] - task.handles.target, axis=1)
    assert extra["handle_error"] == pytest.approx(gap.mean() / diagonal)
    assert twisted.iterations == 60 and twisted.converged is None
    assert extra["loss_curve"].shape == (60, 3)


def test_network_sdf_from_end_to_end():
    small = {"sdf_steps": 40, "sdf_points": 128, "sdf_width": 32, "sdf_layers": 3, "sdf_learning_rate": 3e-3}
    result = implicit_arap(twist(), seed=0, **SMALL | small | {"sdf": "network", "steps": 30})
    assert result.extra["sdf"] == "network" and np.isfinite(result.extra["sdf_loss_last"])
    first, *_, last = result.extra["loss_curve"].sum(axis=1)
    assert last < first


def test_a_task_may_have_moving_or_static_handles_only():
    mesh = icosphere(2)
    for dynamic in (False, True):
        handles = Handles(np.arange(5), mesh.V[:5], dynamic=np.full(5, dynamic))
        result = implicit_arap(DeformationTask("held", mesh, handles), seed=0, **SMALL | {"steps": 10})
        assert np.abs(result.vertices - mesh.V).max() < 0.05 * mesh.diagonal
