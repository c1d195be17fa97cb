"""The shapes of a 3D view: reduced to fewer vertices and packed into text."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.files.skin import DrawnSkin
from sshade.mesh.clusters import cluster_vertices
from sshade.mesh.incidence import members
from sshade.mesh.mesh import Mesh
from sshade.plotting.pictures import CAMERAS, ViewDirection, some
from sshade.problem.handles import Handles
from sshade.proxy.sample import sample_proxy

#: Largest mesh that is shown completely, and number of vertices of larger meshes: of many views, and of one.
SMALL = LIMIT, SAMPLES = 28_000, 20_000
LARGE = 300_000, 100_000
#: Largest number of components that are reduced one by one.
PARTS = 200


class ViewShape(NamedTuple):
    """One shape of a view.

    Attributes
    ----------
    name, caption : str
        The targets of handles are shown on the shape with the name "rest".
    V : (n, 3) float64
    values : (n,) float64, optional
        Values that the colours show.
    """

    name: str
    caption: str
    V: np.ndarray
    values: np.ndarray | None = None


class ViewSurface(NamedTuple):
    """The part of a mesh that the 3D view shows.

    Parameters
    ----------
    samples : (k,) int
        Vertices of the mesh.
    faces : (l, 3) int
        Faces, as indices into `samples`.
    cell : (n,) int
        Index into `samples` of the sample of each vertex of the mesh.
    """

    samples: np.ndarray
    faces: np.ndarray
    cell: np.ndarray

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the means (k,) of values (n,) over the cells of the samples."""
        count = np.bincount(self.cell, minlength=len(self.samples))
        total = np.bincount(self.cell, values, minlength=len(self.samples))
        return np.where(count > 0, total / np.maximum(count, 1), values[self.samples])


def surface(mesh: Mesh, *, keep: np.ndarray, limit: int = LIMIT, samples: int = SAMPLES) -> ViewSurface:
    """Return the mesh, or above `limit` vertices a coarser surface of about `samples` vertices.

    The coarser surface consists of a proxy for each component, and its vertices include `keep`. For a
    component that is not manifold, or more than :data:`PARTS` components, it consists of clusters, and the
    vertices `keep` are beside them. All its vertices are vertices of the mesh, and move with a deformation of
    the mesh.
    """
    if mesh.n <= limit:
        return ViewSurface(np.arange(mesh.n), mesh.F, np.arange(mesh.n))
    if 1 < mesh.topology.components <= PARTS:
        return _surface_of_parts(mesh, keep, samples)
    try:
        coarse = sample_proxy(mesh, max(samples, len(keep)), first=keep)
        return ViewSurface(coarse.samples, coarse.faces, coarse.cell)
    except InputError:
        few = cluster_vertices(mesh, samples)
        beside = np.setdiff1d(keep, few.vertices)
        return ViewSurface(np.concatenate([few.vertices, beside]), few.faces, few.cell)


def _surface_of_parts(mesh: Mesh, keep: np.ndarray, samples: int) -> ViewSurface:
    """Reduce each component for itself: clusters of all would join components that touch."""
    component, cell, kept, faces, total = mesh.component, np.zeros(mesh.n, dtype=np.int64), [], [], 0
    count = mesh.topology.components
    vertices, triangles = members(component, count), members(component[mesh.F[:, 0]], count)
    for number, (own, face) in enumerate(zip(vertices, triangles, strict=True)):
        part = mesh.part(own, face)
        first = np.searchsorted(own, keep[component[keep] == number])
        share = max(samples * len(own) // mesh.n, min(samples // count, len(own)))
        some = surface(part, keep=first, limit=share, samples=share)
        cell[own] = some.cell + total
        kept.append(own[some.samples])
        faces.append(some.faces + total)
        total += len(some.samples)
    return ViewSurface(np.concatenate(kept), np.concatenate(faces), cell)


def packed_view(
    mesh: Mesh,
    shapes: Sequence[ViewShape],
    *,
    handles: Handles | None,
    bottom: float = 0.0,
    top: float = 1.0,
    label: str = "",
    camera: ViewDirection = CAMERAS["y"],
    size: tuple[int, int] = SMALL,
    colours: np.ndarray | None = None,
    skin: DrawnSkin | None = None,
) -> dict[str, Any]:
    """Pack the shapes of a mesh with their handles for the script of the view.

    Positions are relative to the centre of the mesh and its diagonal: the browser computes with float32.

    Parameters
    ----------
    mesh : Mesh
        Of a diagonal above 0.
    shapes : sequence of ViewShape
    handles : Handles, optional
        At most :data:`sshade.plotting.pictures.HANDLES` of them are shown.
    bottom, top : float
        Values at the ends of the colour scale.
    label : str
        What the colours show.
    camera : (3,) float and (3,) float
        Direction to the camera, and upward direction.
    size : int and int
        :data:`SMALL` or :data:`LARGE`.
    colours : (n, 3) uint8, optional
        Colours of the vertices in the file.
    skin : DrawnSkin, optional
        Materials of the file, which a mesh shows that is shown completely.

    Returns
    -------
    dict
        Plain values, and the ``data`` of :func:`pack`.
    """
    count = 0 if handles is None else len(handles)
    rows = some(count)
    index = rows if handles is None else handles.index[rows]
    shown = surface(mesh, keep=index, limit=size[0], samples=size[1])
    skin = skin if len(shown.samples) == mesh.n else None
    place = np.full(mesh.n, -1)
    place[shown.samples] = np.arange(len(shown.samples))
    centre, scale = 0.5 * (mesh.V.min(axis=0) + mesh.V.max(axis=0)), mesh.diagonal
    further = [] if colours is None else [colours[shown.samples].astype("u1")]
    if skin is not None:
        further += [skin.vertex.astype("<u4"), skin.uv.astype("<f4"), skin.faces.astype("<u4")]
    packed = pack(
        [(shape.V[shown.samples] - centre) / scale for shape in shapes],
        [None if shape.values is None else shown.mean(shape.values) for shape in shapes],
        shown.faces,
        bottom=bottom,
        top=top,
        further=further,
    )
    notes = []
    if len(shown.samples) < mesh.n:
        notes.append(f"{len(shown.samples):,} of {mesh.n:,} vertices are shown.")
    if len(rows) < count:
        notes.append(f"{len(rows):,} of {count:,} handles are shown.")
    targets = np.zeros((0, 3)) if handles is None else (handles.target[rows] - centre) / scale
    return packed | {
        "note": " ".join(notes),
        "vertices": len(shown.samples),
        "faces": len(shown.faces),
        "label": label,
        "bottom": bottom,
        "top": top,
        "shapes": [
            {"name": shape.name, "caption": shape.caption, "error": shape.values is not None}
            for shape in shapes
        ],
        "handles": place[index].tolist(),
        "dynamic": [] if handles is None else handles.dynamic[rows].tolist(),
        "targets": targets.round(6).tolist(),
        "camera": {"towards": np.asarray(camera[0]).tolist(), "up": np.asarray(camera[1]).tolist()},
        "painted": colours is not None,
        "skin": None if skin is None else _materials(skin),
    }


def _materials(skin: DrawnSkin) -> dict[str, Any]:
    """Return the materials of a skin, with their images as base64."""
    images = [None if one.texture is None else one.texture() for one in skin.materials]
    return {
        "vertices": len(skin.vertex),
        "runs": skin.runs,
        "materials": [
            {
                "colour": list(map(float, one.colour)),
                "image": image and base64.b64encode(image).decode("ascii"),
            }
            for one, image in zip(skin.materials, images, strict=True)
        ],
    }


def pack(
    shapes: list[np.ndarray],
    values: list[np.ndarray | None],
    faces: np.ndarray,
    *,
    bottom: float = 0.0,
    top: float,
    further: Sequence[np.ndarray] = (),
) -> dict[str, Any]:
    """Pack shapes of one mesh as compressed base64.

    Little-endian: the faces as uint32; then for each shape its positions as uint16 in the bounding box of all
    shapes, coordinate by coordinate; and its values, if it has some, as uint8 of the range of the colours;
    then `further` arrays. Each array begins at a multiple of four bytes.

    Parameters
    ----------
    shapes : list of (k, 3) float64
    values : list of (k,) float64 or None
    faces : (l, 3) int
    bottom, top : float
        Range of the colours.

    Returns
    -------
    dict
        ``low`` and ``span`` of the box, and the ``data``.
    """
    points = np.concatenate(shapes)
    low = points.min(axis=0)
    span = np.maximum(points.max(axis=0) - low, np.finfo(np.float32).tiny)
    parts = [faces.astype("<u4")]
    for V, value in zip(shapes, values, strict=True):
        parts.append(np.rint((V - low) / span * 65535).astype("<u2").T)
        if value is not None:
            height = np.clip((value - bottom) / (top - bottom), 0, 1)
            parts.append(np.rint(255 * height).astype("u1"))
    filled = (part.tobytes() + bytes(-part.nbytes % 4) for part in (*parts, *further))
    packed = gzip.compress(b"".join(filled), compresslevel=6, mtime=0)
    return {"low": low.tolist(), "span": span.tolist(), "data": base64.b64encode(packed).decode("ascii")}
