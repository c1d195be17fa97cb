"""Implicit-ARAP: networks, distances, patches, energy, and small runs."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra torch is not installed")

from scipy.spatial.transform import Rotation  # noqa: E402

from baselines.implicit_arap import implicit_arap  # noqa: E402
from baselines.implicit_arap.networks import euler_rotation  # noqa: E402
from baselines.implicit_arap.patches import pattern_of  # noqa: E402
from baselines.implicit_arap.sdf import ImplicitSurface, fit_network_sdf  # noqa: E402
from sshade.problem.task import silent  # noqa: E402
from tests.shapes import held_ends, icosphere  # noqa: E402

CPU = torch.device("cpu")
SMALL = {"sdf": "grid", "grid_size": 32, "width": 48, "layers": 3, "steps": 60, "device": "cpu"}
SMALL |= {"surface_patches": 80, "space_patches": 40, "patch_points": 12, "projections": 2}


def random():
    return {"generator": generator(), "weights": generator()}


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def twist():
    """A task on an icosphere: the lower cap stays, the upper cap turns by 40 degrees about z and rises."""
    return held_ends(icosphere(3), share=0.1, turn=Rotation.from_euler("z", 40, degrees=True).as_matrix())


def test_euler_angles_compose_x_then_y_then_z():
    angles = 6 * torch.rand(50, 3, generator=generator(), dtype=torch.float64) - 3
    expected = Rotation.from_euler("XYZ", angles.numpy()).as_matrix()
    np.testing.assert_allclose(euler_rotation(angles).numpy(), expected, atol=1e-12)


def test_fitted_network_approaches_the_distance():
    sphere = icosphere(3)
    surface = ImplicitSurface.of(0.7 * sphere.V, sphere.F, device=CPU)
    settings = {"width": 32, "layers": 4, "frequencies": 2, "points": 256, "learning_rate": 1e-3}
    x = 0.7 * torch.nn.functional.normalize(torch.rand(300, 3, generator=generator(1)) - 0.5, dim=-1)

    def off_surface(steps):
        sdf, loss = fit_network_sdf(surface, steps=steps, **settings, **random(), progress=silent)
        assert np.isfinite(loss)
        return sdf, sdf(x).abs().mean()

    (_, before), (sdf, after) = off_surface(1), off_surface(150)
    assert after < 0.04 < 0.2 < before
    _, gradient = sdf.with_gradient(x)
    assert torch.nn.functional.cosine_similarity(gradient, x, dim=-1).mean() > 0.9


def test_energy_of_a_stretch_by_hand():
    """Stretch a unit square by 1.5 along x, with R = 1. Its sides along x have weight 1 and count twice."""
    pattern = pattern_of(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]), np.array([[0, 1, 2], [0, 2, 3]]))
    flat = torch.nn.functional.pad(pattern.points, (0, 1))[None]
    eye = torch.eye(3).expand(*flat.shape, 3)
    energy = pattern.energy(flat, eye, flat * torch.tensor([1.5, 1, 1]))
    assert energy.item() == pytest.approx(2 * 2 * 0.5**2)


def test_a_small_run_lowers_the_loss_and_meets_the_handles():
    task = twist()
    twisted = implicit_arap(task, seed=4, **SMALL)
    extra = twisted.extra
    first, *_, last = extra["loss_curve"].sum(axis=1)
    assert last < first / 10
    assert extra["handle_error"] < 0.02
    gap = np.linalg.norm(twisted.vertices[task.handles.index] - task.handles.target, axis=1)
    assert extra["handle_error"] == pytest.approx(gap.mean() / task.mesh.diagonal)
    assert twisted.iterations == 60 and twisted.converged is None
    assert extra["loss_curve"].shape == (60, 3)


def test_network_sdf_from_end_to_end():
    small = {"sdf_steps": 40, "sdf_points": 128, "sdf_width": 32, "sdf_layers": 3, "sdf_learning_rate": 3e-3}
    result = implicit_arap(twist(), seed=0, **SMALL | small | {"sdf": "network", "steps": 30})
    assert result.extra["sdf"] == "network" and np.isfinite(result.extra["sdf_loss_last"])
    first, *_, last = result.extra["loss_curve"].sum(axis=1)
    assert last < first
