from __future__ import annotations

import numpy as np
import pytest

from sshade import Binding, InputError, Mesh, bind
from sshade.sampling.remesh import remesh
from tests.shapes import bent, family, rotation

#: Positions agree to rounding: this times the bounding-box diagonal.
ROUNDING = 1e-12

MESHES = family()


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("projection", ["fan", "surface"])
@pytest.mark.parametrize("function", ["extent", "best", "x"])
def test_an_undeformed_proxy_gives_the_mesh_back(name, projection, function):
    mesh = MESHES[name]
    binding = bind(mesh, mesh.n // 6, projection=projection, frame_function=function)
    V, degenerate = binding.carry(binding.proxy.V)
    assert degenerate == 0
    assert np.abs(V - mesh.V).max() <= ROUNDING * mesh.diagonal


@pytest.mark.parametrize("name", MESHES)
def test_a_rigid_motion_of_the_proxy_is_one_of_the_mesh(name):
    mesh, turn, shift = MESHES[name], rotation(1), np.array([3.0, -1, 2])
    binding = bind(mesh, mesh.n // 6)
    V, _ = binding.carry(binding.proxy.V @ turn.T + shift)
    assert np.abs(V - (mesh.V @ turn.T + shift)).max() <= ROUNDING * mesh.diagonal


def test_samples_follow_their_proxy_vertices_where_the_proxy_turns_little():
    """A frame is no interpolation: vertices leave N' by what its triangles stretch, and no more."""
    mesh = MESHES["bumpy"]
    binding = bind(mesh, mesh.n // 3)
    for amount in (1e-2, 1e-3):
        NV = bent(binding.proxy.V, amount)
        V, _ = binding.carry(NV)
        longest = np.linalg.norm(np.diff(binding.proxy.V[binding.proxy.edges], axis=1), axis=2).max()
        assert np.linalg.norm(V[binding.remesh.samples] - NV, axis=1).max() <= 12 * amount * longest
        assert np.abs(V - bent(mesh.V, amount)).max() <= 12 * amount * longest


@pytest.mark.parametrize("exponent", [-40, 3, 40])
def test_scaling_by_a_power_of_two_changes_no_bit(exponent):
    mesh, scale = MESHES["bumpy"], 2.0**exponent
    a, b = bind(mesh, 80), bind(Mesh(mesh.V * scale, mesh.F), 80)
    NV = bent(a.proxy.V)
    assert np.array_equal(a.carry(NV)[0] * scale, b.carry(NV * scale)[0])


def test_renumbering_the_mesh_renumbers_the_result():
    mesh, rng = MESHES["bumpy"], np.random.default_rng(4)
    # All samples are given, for the random one is drawn by number.
    first = remesh(mesh, 60, seed=1).samples[:60]
    new_id = rng.permutation(mesh.n)
    V = np.empty_like(mesh.V)
    V[new_id] = mesh.V
    F = np.array([np.roll(f, r) for f, r in zip(new_id[mesh.F], rng.integers(0, 3, mesh.m), strict=True)])
    for extra in ({}, {"frame_function": "best"}, {"projection": "surface"}):
        a = bind(mesh, 60, first=first, **extra)
        b = bind(Mesh(V, rng.permutation(F)), 60, first=new_id[first], **extra)
        assert np.array_equal(new_id[a.remesh.samples], b.remesh.samples)
        assert np.array_equal(a.remesh.region, b.remesh.region[new_id])
        A, B = a.carry(bent(a.proxy.V))[0], b.carry(bent(b.proxy.V))[0]
        assert np.abs(A - B[new_id]).max() <= 1e-9 * mesh.diagonal


def test_a_frame_function_is_given_at_the_vertices_of_the_mesh():
    mesh = MESHES["bumpy"]
    a, b = bind(mesh, 80, frame_function=7 * mesh.V[:, 2] + 1), bind(mesh, 80, frame_function="z")
    steep = np.abs(a.frames.L - b.frames.L).max(axis=(1, 2)) < 1e-9
    assert steep.mean() > 0.8
    with pytest.raises(InputError, match=r"needs 642 values, one a vertex, not \(3,\)"):
        bind(mesh, 80, frame_function=np.ones(3))


def test_a_binding_read_back_carries_the_same_bits(tmp_path):
    for name, mesh in MESHES.items():
        binding = bind(mesh, mesh.n // 6, frame_function="best")
        binding.save(tmp_path / f"{name}.npz")
        again = Binding.load(tmp_path / f"{name}.npz", mesh)
        NV = bent(binding.proxy.V)
        assert np.array_equal(binding.carry(NV)[0], again.carry(NV)[0])
        assert np.array_equal(binding.remesh.samples, again.remesh.samples)
        assert np.array_equal(binding.projection.barycentric, again.projection.barycentric)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(f"{name}.npz" for name in MESHES)


def damaged(path, **changes) -> None:
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files}
    for name, change in changes.items():
        if change is None:
            del arrays[name]
        else:
            arrays[name] = change(arrays[name])
    with open(path, "wb") as file:
        np.savez(file, **arrays)


@pytest.mark.parametrize(
    "changes",
    [
        {"region": None},
        {"values": lambda a: a[:-1]},
        {"face": lambda a: a[:-1]},
        {"face": lambda a: a + 10**6},
        {"region": lambda a: a - 1},
        {"samples": lambda a: -a},
        {"samples": lambda a: a.astype(float)},
        {"faces": lambda a: a + 10**6},
        {"faces": lambda a: np.full(a.shape, "x")},
    ],
)
def test_a_map_whose_arrays_do_not_fit_together_is_refused(tmp_path, body, changes):
    path = tmp_path / "map.npz"
    bind(body, 50).save(path)
    damaged(path, **changes)
    with pytest.raises(InputError, match="map.npz"):
        Binding.load(path, body)


def test_what_is_no_map_is_refused(tmp_path, body):
    (tmp_path / "empty.npz").write_bytes(b"")
    (tmp_path / "text.npz").write_text("no map")
    bind(body, 50).save(tmp_path / "cut.npz")
    whole = (tmp_path / "cut.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    with open(tmp_path / "array.npz", "wb") as file:
        np.save(file, np.eye(3))
    for name in ("empty", "text", "cut", "array", "missing"):
        with pytest.raises(InputError, match=rf"{name}.npz: not a map written by `sshade remesh`"):
            Binding.load(tmp_path / f"{name}.npz", body)


def test_a_map_of_another_mesh_is_refused(tmp_path, body, small_body):
    bind(body, 50).save(tmp_path / "map.npz")
    with pytest.raises(InputError, match="the map is of a mesh with 642 vertices, this one has 162"):
        Binding.load(tmp_path / "map.npz", small_body)


def test_a_proxy_of_another_size_is_refused(body):
    with pytest.raises(InputError, match=r"the proxy has vertices of shape \(\d+, 3\), not \(4, 3\)"):
        bind(body, 50).carry(np.zeros((4, 3)))
