"""Splats in files: covariance and colours follow the map, everything else stays."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import InputError
from sshade.io.meshes import read_surface
from sshade.io.splats import harmonics, moved_shapes, read_points, turned_harmonics
from tests.write import columns, ply

RNG = np.random.default_rng(0)
NAMES = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 {} opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3"


def names(rest: int = 45) -> list[str]:
    return NAMES.format(" ".join(f"f_rest_{i}" for i in range(rest))).split()


def write_splats(path, X, *, properties=None, order="<", kind="float"):
    """Write splats at X (n, 3), with random numbers for all else; return the numbers (n, p)."""
    properties = names() if properties is None else properties
    dtype = {"float": np.float32, "double": np.float64}[kind]
    values = np.random.default_rng(1).normal(size=(len(X), len(properties))).astype(dtype)
    values[:, :3] = X
    vertex = columns(kind, " ".join(properties), values)
    path.write_bytes(ply(order, {"vertex": vertex}, comments=["comment by a test"]))
    return values


def covariances(shapes):
    R = Rotation.from_quat(shapes[:, [1, 2, 3, 0]]).as_matrix()
    return np.einsum("nij,nj,nkj->nik", R, np.exp(2 * shapes[:, 4:]), R)


def colours(C, d):
    """Sample the functions of the direction."""
    Y = np.empty((len(d), 15))
    for row, direction in zip(Y, d, strict=True):
        harmonics.py_func(*direction, row)
    count = C.shape[1] // 3
    return np.einsum("nck,nk->nc", C.reshape(len(C), 3, count), Y[:, :count])


def test_harmonics_are_orthonormal():
    z, w = np.polynomial.legendre.leggauss(8)
    angle = 2 * np.pi * np.arange(16) / 16
    z, angle = (x.ravel() for x in np.meshgrid(z, angle, indexing="ij"))
    r = np.sqrt(1 - z * z)
    Y = np.empty((len(z), 15))
    for row, d in zip(Y, np.stack([r * np.cos(angle), r * np.sin(angle), z], 1), strict=True):
        harmonics.py_func(*d, row)
    assert (Y.T * np.repeat(w, 16)) @ Y * 2 * np.pi / 16 == pytest.approx(np.eye(15), abs=1e-12)


@pytest.mark.parametrize("count", [0, 3, 8, 15])
def test_turned_harmonics_have_the_old_colour_in_the_turned_direction(count):
    C, R = RNG.normal(size=(50, 3 * count)), Rotation.random(50, random_state=1).as_matrix()
    d = RNG.normal(size=(50, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    turned = turned_harmonics(C, R)
    assert colours(turned, np.einsum("nij,nj->ni", R, d)) == pytest.approx(colours(C, d), abs=1e-12)
    assert count == 0 or abs(turned - C).max() > 0.1


def test_covariances_follow_linear_maps():
    shapes = RNG.normal(size=(200, 7))
    J = np.eye(3) + 0.4 * RNG.normal(size=(200, 3, 3))
    moved = moved_shapes(shapes, J)
    want = np.einsum("nij,njk,nlk->nil", J, covariances(shapes), J)
    assert covariances(moved) == pytest.approx(want, rel=1e-10, abs=1e-10)
    assert np.linalg.norm(moved[:, :4], axis=1) == pytest.approx(np.linalg.norm(shapes[:, :4], axis=1))


@pytest.mark.parametrize("J", [np.diag([2.0, 1.0, 0.0]), np.outer([1.0, 2, 3], [0, 1, 0.5])])
def test_splats_of_a_collapsed_surface_are_flat(J):
    shapes = RNG.normal(size=(200, 7))
    shapes[:20, :4] = [1, 0, 0, 0]  # along the axes
    moved = moved_shapes(shapes, np.tile(J, (200, 1, 1)))
    want = np.einsum("ij,njk,lk->nil", J, covariances(shapes), J)
    assert covariances(moved) == pytest.approx(want, rel=1e-7, abs=1e-7)
    assert np.isfinite(moved).all()
    assert np.linalg.norm(moved[:, :4], axis=1) == pytest.approx(np.linalg.norm(shapes[:, :4], axis=1))


def test_rotations_keep_scales_and_the_identity_keeps_everything():
    shapes, R = RNG.normal(size=(50, 7)), Rotation.random(50, random_state=3)
    moved = moved_shapes(shapes, R.as_matrix())
    assert moved[:, 4:] == pytest.approx(shapes[:, 4:], abs=1e-12)
    both = (R * Rotation.from_quat(shapes[:, [1, 2, 3, 0]])).as_matrix()
    assert Rotation.from_quat(moved[:, [1, 2, 3, 0]]).as_matrix() == pytest.approx(both, abs=1e-12)
    assert moved_shapes(shapes, np.tile(np.eye(3), (50, 1, 1))) == pytest.approx(shapes, abs=1e-12)


@pytest.mark.parametrize("normals", ["nx ny nz", "normal_x normal_y normal_z"])
def test_normals_of_points_turn_under_both_names(tmp_path, normals):
    properties = ["x", "y", "z", *normals.split()]
    values = write_splats(tmp_path / "a.ply", RNG.normal(size=(9, 3)), properties=properties)
    points, R = read_points(tmp_path / "a.ply"), Rotation.from_rotvec([0, 0, 1]).as_matrix()
    points.write(tmp_path / "b.ply", points.V, np.tile(R, (9, 1, 1)), np.tile(R, (9, 1, 1)))
    vertices = read_points(tmp_path / "b.ply").ply.elements["vertex"]
    assert vertices.columns(vertices.numbers(normals)) == pytest.approx(values[:, 3:] @ R.T, abs=1e-6)


def test_flat_splats_and_collapsing_maps_stay_finite():
    shapes = np.zeros((3, 7))
    shapes[:, 0] = 2.0
    shapes[0, 4:] = [0.0, -1.0, -80.0]
    shapes[1, :4] = 0.0  # no rotation: the splat stays
    J = np.stack([Rotation.from_rotvec([0, 0, 1]).as_matrix(), 2 * np.eye(3), np.zeros((3, 3))])
    moved = moved_shapes(shapes, J)
    assert moved[0, 4:] == pytest.approx([0.0, -1.0, -80.0], abs=1e-9)
    assert (moved[1:] == shapes[1:]).all()


@pytest.mark.parametrize(("order", "kind"), [("<", "float"), ("<", "double"), ("", "double")])
def test_all_properties_of_a_file_are_kept(tmp_path, order, kind):
    path, out = tmp_path / "scene.ply", tmp_path / "out.ply"
    properties = [*names(24), "mine"]
    values = write_splats(path, RNG.normal(size=(9, 3)), properties=properties, order=order, kind=kind)
    points = read_points(path)
    assert points.is_splats and pytest.approx(values[:, :3]) == points.V
    R = Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix()
    points.write(out, points.V + 1, np.tile(R, (9, 1, 1)), np.tile(2 * R, (9, 1, 1)))
    again = read_points(out)
    column = {name: i for i, name in enumerate(properties)}
    new = again.ply.elements["vertex"].columns(list(range(len(properties))))
    for name in ("f_dc_0", "f_dc_1", "f_dc_2", "opacity", "mine"):
        assert (new[:, column[name]] == values[:, column[name]]).all()
    assert new[:, :3] == pytest.approx(values[:, :3] + 1)
    assert new[:, 3:6] == pytest.approx(values[:, 3:6] @ R.T, abs=1e-6)
    scales = [column[f"scale_{i}"] for i in range(3)]
    assert new[:, scales] == pytest.approx(values[:, scales] + np.log(2), abs=1e-6)
    assert b"comment by a test" in out.read_bytes()


@pytest.mark.parametrize(
    ("properties", "words"),
    [
        ([n for n in names() if n != "scale_2"], "scale_2, and the file has scale_0, scale_1;"),
        ([n for n in names() if not n.startswith("rot_")], "rot_3, and the file has none"),
        (names(44), "has 44 properties f_rest_"),
    ],
)
def test_other_layouts_are_refused(tmp_path, properties, words):
    write_splats(tmp_path / "scene.ply", np.zeros((2, 3)), properties=properties)
    with pytest.raises(InputError, match=words):
        read_points(tmp_path / "scene.ply")


def test_compressed_splats_are_refused(tmp_path):
    header = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uint packed_position\n"
    (tmp_path / "scene.ply").write_bytes(header + b"end_header\n" + bytes(4))
    with pytest.raises(InputError, match="compressed splats"):
        read_points(tmp_path / "scene.ply")


def test_splats_alone_are_no_mesh(tmp_path):
    write_splats(tmp_path / "scene.ply", np.zeros((2, 3)))
    with pytest.raises(InputError, match="holds Gaussian splats and no surface; give a mesh"):
        read_surface(tmp_path / "scene.ply")
