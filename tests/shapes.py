"""Small meshes of known topology for the tests, made without files, and handles at their ends."""

from dataclasses import replace

import numpy as np

from sshade import DeformationTask, Handles, Mesh
from sshade.mesh.incidence import sides_by_edge

NO_TURN = np.eye(3)
#: A quarter turn about z.
QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def tetrahedron() -> Mesh:
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    return Mesh(V, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))


def icosphere(level: int) -> Mesh:
    """Unit sphere of 10 x 4^level + 2 vertices."""
    p = (1 + 5**0.5) / 2
    V = [[-1, p, 0], [1, p, 0], [-1, -p, 0], [1, -p, 0], [0, -1, p], [0, 1, p]]
    V += [[0, -1, -p], [0, 1, -p], [p, 0, -1], [p, 0, 1], [-p, 0, -1], [-p, 0, 1]]
    F = [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4]]
    F += [[11, 10, 2], [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8]]
    F += [[3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]]
    mesh = Mesh(np.array(V, dtype=float), np.array(F))
    for _ in range(level):
        mesh = subdivided(mesh)
    return Mesh(mesh.V / np.linalg.norm(mesh.V, axis=1, keepdims=True), mesh.F)


def subdivided(mesh: Mesh) -> Mesh:
    """Cut every triangle into four at the midpoints of its edges."""
    a, b, c = mesh.F.T
    ab, bc, ca = mesh.n + sides_by_edge(mesh.F, mesh.n).edge.T
    F = np.stack([a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca], axis=1).reshape(-1, 3)
    return Mesh(np.concatenate([mesh.V, mesh.V[mesh.edges].mean(axis=1)]), F)


def quads(nu: int, nv: int, *, wrap_u: bool = False, wrap_v: bool = False) -> np.ndarray:
    """Faces of a lattice of nu x nv vertices, each square cut along the same diagonal."""
    i, j = (k.ravel() for k in np.indices((nu if wrap_u else nu - 1, nv if wrap_v else nv - 1)))
    a, b = i * nv + j, (i + 1) % nu * nv + j
    c, d = (i + 1) % nu * nv + (j + 1) % nv, i * nv + (j + 1) % nv
    return np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)


def strip(length: int, width: int) -> Mesh:
    """Flat regular grid of length x width unit squares: a disc with many equal distances."""
    x, y = np.meshgrid(np.arange(length + 1.0), np.arange(width + 1.0), indexing="ij")
    V = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    return Mesh(V, quads(length + 1, width + 1))


def folded(length: int = 80, width: int = 16, *, gap: float = 0.05) -> Mesh:
    """Fold a strip onto itself. Its two curved layers are `gap` apart; the order of vertices stays."""
    sheet = strip(length, width)
    x, y, _ = jittered(sheet, 0.1).V.T
    upper = x > length / 2
    along = np.where(upper, length - x, x)
    return Mesh(np.stack([along, y, np.sin(0.3 * along) + gap * upper], axis=1), sheet.F)


def torus(nu: int = 24, nv: int = 12, *, radius: float = 1.0, tube: float = 0.4) -> Mesh:
    u, v = (2 * np.pi * a.ravel() for a in np.meshgrid(np.arange(nu) / nu, np.arange(nv) / nv, indexing="ij"))
    ring = radius + tube * np.cos(v)
    V = np.stack([ring * np.cos(u), ring * np.sin(u), tube * np.sin(v)], axis=1)
    return Mesh(V, quads(nu, nv, wrap_u=True, wrap_v=True))


def tube(around: int = 16, along: int = 30, *, length: float = 6.0) -> Mesh:
    """Open cylinder of radius 1: two boundary loops."""
    u, z = (a.ravel() for a in np.meshgrid(np.arange(around) / around, np.arange(along) / (along - 1)))
    V = np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), length * z], axis=1)
    F = quads(along, around, wrap_v=True)
    return Mesh(V, F[:, ::-1])


def block(solid: np.ndarray, *, cells: int = 1) -> Mesh:
    """Surface of a solid made of unit cubes, each cut into cells^3.

    Faces point outwards. Cubes that touch only along an edge or at a corner make the surface non-manifold.
    """
    solid = np.kron(np.asarray(solid, dtype=np.int8), np.ones((cells,) * 3, dtype=np.int8)).astype(bool)
    filled = np.pad(solid, 1)
    ids: dict[tuple[int, ...], int] = {}
    faces = []
    for axis in range(3):
        u, v = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        step = np.eye(3, dtype=int)[axis]
        for cell in np.argwhere(filled):
            for side in (0, 1):
                if filled[tuple(cell + (2 * side - 1) * step)]:
                    continue
                corner = cell + side * step
                places = (corner, corner + u, corner + u + v, corner + v)
                ring = [ids.setdefault(tuple(p), len(ids)) for p in places]
                a, b, c, d = ring if side else ring[::-1]
                faces += [(a, b, c), (a, c, d)]
    return Mesh(np.array(list(ids), dtype=float) / cells, np.array(faces))


def beside(*meshes: Mesh) -> Mesh:
    """Join meshes into one mesh of several components."""
    offset = np.cumsum([0, *(mesh.n for mesh in meshes[:-1])])
    faces = [mesh.F + o for mesh, o in zip(meshes, offset, strict=True)]
    return Mesh(np.concatenate([mesh.V for mesh in meshes]), np.concatenate(faces))


def unjoined(mesh: Mesh) -> Mesh:
    """Return the mesh with three separate vertices for each face."""
    return Mesh(mesh.V[mesh.F].reshape(-1, 3), np.arange(3 * mesh.m).reshape(-1, 3))


def shifted(mesh: Mesh, shift) -> Mesh:
    """Return the mesh moved by `shift`."""
    return Mesh(mesh.V + shift, mesh.F)


def torn(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return V and F of a mesh cut along a seam across its middle, and the vertices (k,) on the seam.

    V begins with a vertex that belongs to no face. The vertices of the mesh follow, then k copies of the
    vertices on the seam. The faces on one side of the seam use the copies.
    """
    behind = mesh.V[mesh.F].mean(axis=1)[:, 0] > mesh.V[:, 0].mean()
    seam = np.intersect1d(mesh.F[behind], mesh.F[~behind])
    copy = np.arange(mesh.n)
    copy[seam] = mesh.n + np.arange(len(seam))
    V = np.concatenate([[[9.0, 9, 9]], mesh.V, mesh.V[seam]])
    return V, 1 + np.where(behind[:, None], copy[mesh.F], mesh.F), 1 + seam


def as_obj(V: np.ndarray, F: np.ndarray) -> str:
    """The text of an OBJ file with a colour and a texture coordinate at every vertex, and a material."""
    lines = ["# by hand", "mtllib skin.mtl"]
    lines += [f"v {x!r} {y!r} {z!r} 0.5 0.5 0.5" for x, y, z in V.tolist()]
    lines += [f"vt {x!r} {y!r}" for x, y, _ in V.tolist()] + ["usemtl skin"]
    lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in (F + 1).tolist()]
    return "\n".join(lines) + "\n"


def two_spheres() -> Mesh:
    """Unit spheres at a distance of 5."""
    return beside(icosphere(2), shifted(icosphere(2), [5, 0, 0]))


def double_torus(*, cells: int = 2) -> Mesh:
    """A plate with two square holes, jittered: genus 2."""
    solid = np.ones((5, 3, 1))
    solid[1, 1], solid[3, 1] = 0, 0
    return jittered(block(solid, cells=cells), 0.05 / cells)


def jittered(mesh: Mesh, amount: float, *, seed: int = 0) -> Mesh:
    """Move every coordinate at random by up to `amount`, so that no two distances are equal."""
    rng = np.random.default_rng(seed)
    return Mesh(mesh.V + rng.uniform(-amount, amount, mesh.V.shape), mesh.F)


def bumpy(level: int = 3) -> Mesh:
    """Closed surface without symmetry. Its longest axis is z; its second longest is y."""
    mesh = icosphere(level)
    x, y, z = mesh.V.T
    radius = 1 + 0.2 * np.sin(3 * x + 1) + 0.1 * np.cos(5 * y + z) + 0.1 * np.sin(2 * z - 4 * x * y)
    return Mesh(mesh.V * radius[:, None] * [1.0, 1.3, 2.0], mesh.F)


def bent(V: np.ndarray, amount: float = 0.3) -> np.ndarray:
    """Move points by a smooth non-rigid map. Tests deform proxies with it, without a solver."""
    x, y, z = V.T
    return np.stack([x + amount * z**2, y + amount * np.sin(x), z + 0.5 * amount * x * y], axis=1)


def rotation(seed: int = 0) -> np.ndarray:
    """A rotation in general position."""
    Q, R = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q * np.linalg.det(Q)


def family() -> dict[str, Mesh]:
    """A mesh of each topology that the method keeps: sphere, genus 2, tube and disc."""
    found = {"bumpy": bumpy(3), "double torus": double_torus(cells=3)}
    return {**found, "tube": jittered(tube(), 0.02), "strip": jittered(strip(30, 5), 0.1)}


def end_handles(
    V, *, axis=2, share=0.1, count: int | None = None, turn=NO_TURN, shift=(0.0, 0, 0)
) -> Handles:
    """Return handles at both ends along an axis. The lower end stays; the upper end is turned and shifted.

    Each end covers the fraction `share` of the extent, or has `count` vertices if `count` is given.
    """
    x = V[:, axis]
    if count is None:
        low = np.flatnonzero(x <= x.min() + share * np.ptp(x))
        high = np.flatnonzero(x >= x.max() - share * np.ptp(x))
    else:
        order = upwards(V, axis)
        low, high = order[:count], order[-count:]
    own = moved_parts(V, (low, 0), (high, lambda V: V @ turn.T + shift))
    return replace(own, dynamic=own.group > 0)


def upwards(V: np.ndarray, axis: int = 2) -> np.ndarray:
    """Return the vertices in ascending order along an axis, the same where processors round differently."""
    return np.argsort(V[:, axis].round(9), kind="stable")


def moved_parts(V: np.ndarray, *parts, weights=np.inf, rotations=None, **more) -> Handles:
    """Return groups of handles. Each part has vertices, as ids or a mask, and a shift or map that moves them.

    Rotations have one entry for each group; None leaves the rotation of its group free. Weights have one
    entry for each group, or one number applies to all groups.
    """
    index = [np.arange(len(V))[vertices] for vertices, _ in parts]
    group = np.repeat(np.arange(len(parts)), [len(own) for own in index])
    pairs = zip(index, parts, strict=True)
    target = [move(V[own]) if callable(move) else V[own] + move for own, (_, move) in pairs]
    more = {"group": group, "weight": np.broadcast_to(weights, len(parts))[group], **more}
    if rotations is not None:
        more["rotation"] = np.array([np.full((3, 3), np.nan) if R is None else R for R in rotations])[group]
    return Handles(np.concatenate(index), np.concatenate(target), **more)


def of_all(*given: tuple[Handles, int]) -> Handles:
    """Join handles of several meshes. Each pair has handles and the number to add to their vertex ids."""
    return Handles(
        np.concatenate([handles.index + offset for handles, offset in given]),
        np.concatenate([handles.target for handles, _ in given]),
        dynamic=np.concatenate([handles.dynamic for handles, _ in given]),
        weight=np.concatenate([handles.weight for handles, _ in given]),
        group=np.concatenate([handles.group + 2 * i for i, (handles, _) in enumerate(given)]),
    )


def held_ends(mesh: Mesh, *, axis: int = 2, share: float = 0.15, turn=QUARTER) -> DeformationTask:
    """Return a task that fixes the lower end along an axis.

    The upper end turns about the origin and rises by 0.1 along the axis.
    """
    handles = end_handles(mesh.V, axis=axis, share=share, turn=turn, shift=0.1 * np.eye(3)[axis])
    return DeformationTask("ends", mesh, handles)
