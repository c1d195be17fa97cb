"""Draw splats before and after a pose, ``python -m docs.carried``: docs/figures/carried.png.

A rod bends by 100 degrees. Splats with stripes lie on it, and thin splats stand off like hair. A small
reference renderer projects the Gaussians along an axis and blends them from back to front.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from scipy.spatial.transform import Rotation

from eval.studies.goals import bent, capsule
from eval.timing.carried import covariances
from sshade.carry.points import bind_points
from sshade.io.splats import moved_shapes
from sshade.mesh.mesh import Mesh

FIGURE = Path(__file__).parent / "figures" / "carried.png"
SPLATS, HAIRS = 12_000, 1500
PIXELS = 260


def scene(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (n, 3), shapes (n, 7) and colours (n, 3) of splats on a rod, and of hair on it."""
    rng = np.random.default_rng(0)
    count = SPLATS + HAIRS
    face = rng.choice(mesh.m, count, p=mesh.face_areas / mesh.area)
    normal = mesh.face_normals[face]
    on = mesh.V[mesh.F[face]].mean(axis=1)
    hair = np.arange(count) >= SPLATS
    X = on + np.where(hair, 0.25, 0.0)[:, None] * normal
    helper = np.cross(normal, [0.0, 0.0, 1.0] + 1e-3 * rng.normal(size=(count, 3)))
    helper /= np.linalg.norm(helper, axis=1, keepdims=True)
    Q = Rotation.from_matrix(np.stack([helper, np.cross(normal, helper), normal], axis=2)).as_quat()
    scales = np.where(hair[:, None], [0.02, 0.02, 0.16], [0.09, 0.09, 0.01])
    stripe = np.sin(3 * on[:, 2]) > 0
    colour = np.where(stripe[:, None], [0.85, 0.45, 0.2], [0.25, 0.45, 0.75])
    colour[hair] = [0.15, 0.15, 0.15]
    return X, np.concatenate([Q[:, [3, 0, 1, 2]], np.log(scales)], axis=1), colour


def render(X: np.ndarray, shapes: np.ndarray, colours: np.ndarray, box: tuple[float, ...]) -> np.ndarray:
    """Blend Gaussians, seen along y, from back to front into a picture (h, w, 3) of x and z."""
    S = covariances(shapes)[:, ::2, ::2]
    left, right, low, high = box
    scale = PIXELS / (high - low)
    picture = np.ones((PIXELS, int((right - left) * scale), 3))
    for i in np.argsort(-X[:, 1]):
        inverse, spread = np.linalg.inv(S[i] + 0.2 * np.eye(2) / scale**2), 3 * np.sqrt(np.diag(S[i]))
        x, z = (X[i, 0] - left) * scale, (X[i, 2] - low) * scale
        rx, rz = spread * scale + 2
        columns = np.arange(max(0, int(x - rx)), min(picture.shape[1], int(x + rx) + 1))
        rows = np.arange(max(0, int(z - rz)), min(PIXELS, int(z + rz) + 1))
        dx, dz = (columns - x)[None] / scale, (rows - z)[:, None] / scale
        power = inverse[0, 0] * dx**2 + 2 * inverse[0, 1] * dx * dz + inverse[1, 1] * dz**2
        alpha = (0.9 * np.exp(-0.5 * power))[..., None]
        part = picture[rows[:, None], columns[None]]
        picture[rows[:, None], columns[None]] = (1 - alpha) * part + alpha * colours[i]
    return picture[::-1]


def main() -> None:
    """Write the figure."""
    mesh = capsule(8.0)
    X, shapes, colours = scene(mesh)
    found = bind_points(mesh, X).with_maps(bent(mesh.V, 100.0))
    moved = moved_shapes(shapes, found.maps)
    parts = [
        ("rest", X, shapes, (-2.0, 2.0, -1.0, 9.0)),
        ("positions alone", found.positions, shapes, (-2.0, 7.5, -1.0, 7.5)),
        ("with rotations and scales", found.positions, moved, (-2.0, 7.5, -1.0, 7.5)),
    ]
    figure, axes = plt.subplots(1, 3, figsize=(8.5, 3), width_ratios=[1, 2.2, 2.2])
    for axis, (title, places, own, box) in zip(axes, parts, strict=True):
        axis.imshow(render(places, own, colours, box))
        axis.set_title(title, fontsize=9)
        axis.axis("off")
    figure.tight_layout()
    figure.savefig(FIGURE, dpi=100)


if __name__ == "__main__":
    main()
