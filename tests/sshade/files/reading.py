"""Read mesh files with trimesh, meshio and plain text, without code of the package."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import meshio
import numpy as np
import trimesh

#: Properties of PLY that a deformation changes.
MOVED = ("x", "y", "z", "nx", "ny", "nz")
#: A facet of a binary STL file.
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: Parts of a glTF file that refer to its buffer by numbers, which may change.
NUMBERED = ("buffers", "bufferViews", "accessors", "meshes", "images")


class Content(NamedTuple):
    """What a reader finds in a file.

    Attributes
    ----------
    V : (n, 3) float64
        Positions, where the scene places them.
    N : (k, 3) float64
        Normals; empty if the reader finds none.
    rest : list
        Everything else.
    """

    V: np.ndarray
    N: np.ndarray
    rest: list[Any]


def by_trimesh(path: Path) -> Content:
    """Read vertices, faces, normals, colours, texture coordinates, materials and other attributes."""
    scene = trimesh.load_scene(path, process=False, maintain_order=True)
    V, N, rest = [np.zeros((0, 3))], [np.zeros((0, 3))], []
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name]
        V.append(trimesh.transform_points(mesh.vertices, matrix))
        rest.append(type(mesh).__name__)
        if not isinstance(mesh, trimesh.Trimesh):
            continue
        for kind in ("vertex_normals", "face_normals"):
            if kind in mesh._cache.cache:  # they come from the file
                normals = getattr(mesh, kind) @ np.linalg.inv(matrix[:3, :3])
                N.append(normals / np.linalg.norm(normals, axis=1, keepdims=True))
        rest += [mesh.faces, *_looks(mesh.visual), mesh.vertex_attributes, mesh.face_attributes]
        elements = mesh.metadata.get("_ply_raw", {})
        rest += [_columns(element["data"]) for element in elements.values() if element.get("length")]
    return Content(np.concatenate(V), np.concatenate(N), rest)


def _looks(visual: Any) -> list[Any]:
    """Return colours of vertices or faces, or texture coordinates and the material."""
    if visual.kind in ("vertex", "face"):
        return [visual.kind, getattr(visual, f"{visual.kind}_colors")]
    if visual.kind != "texture":
        return []
    image = getattr(visual.material, "image", None) or getattr(visual.material, "baseColorTexture", None)
    return [visual.uv, visual.material.name, image and image.tobytes()]


def _columns(data: Any) -> dict[str, Any]:
    """Return the properties of an element of PLY that stay."""
    names = data.keys() if isinstance(data, dict) else data.dtype.names
    return {name: np.asarray(data[name]).tolist() for name in names if name not in MOVED}


def by_meshio(path: Path) -> Content:
    """Read points, cells of all sizes, and their data."""
    mesh = meshio.read(path)
    data = {name: values for name, values in mesh.point_data.items() if name not in MOVED}
    N = data.pop("obj:vn", None)
    if N is None and "nx" in mesh.point_data:
        N = np.column_stack([mesh.point_data[name] for name in ("nx", "ny", "nz")])
    cells = [(block.type, block.data) for block in mesh.cells]
    N = np.zeros((0, 3)) if N is None else np.asarray(N, dtype=float)
    return Content(mesh.points[:, :3], N, [mesh.points[:, 3:], cells, data, mesh.cell_data])


def by_text(path: Path) -> Content:
    """Read an OBJ or OFF file, a header of PLY or STL, or the JSON of a glTF file."""
    data, suffix = path.read_bytes(), path.suffix
    none = np.zeros((0, 3))
    if suffix == ".ply":
        return Content(none, none, data[: data.index(b"end_header")].splitlines(keepends=True))
    if suffix in (".glb", ".gltf"):
        start = 20 if suffix == ".glb" else 0
        tree = json.loads(data[start:][: int.from_bytes(data[12:16], "little") if start else None])
        nodes = [{key: node[key] for key in node if key != "mesh"} for node in tree["nodes"]]
        shown = [tree["meshes"][node["mesh"]] for node in tree["nodes"] if "mesh" in node]
        primitives = [p for mesh in shown for p in mesh["primitives"]]
        parts = [[sorted(p["attributes"]), p.get("material"), p.get("mode", 4)] for p in primitives]
        rest = {key: value for key, value in tree.items() if key not in (*NUMBERED, "nodes")}
        return Content(none, none, [rest, nodes, parts])
    if suffix == ".stl" and len(data) == 84 + FACET.itemsize * int.from_bytes(data[80:84], "little"):
        facets = np.frombuffer(data[84:], FACET)
        V = facets["corners"].reshape(-1, 3).astype(float)
        return Content(V, facets["normal"].astype(float), [data[:84], facets["attribute"]])
    lines = data.decode().splitlines(keepends=True)
    if suffix == ".off":
        return _off([line.partition("#")[0].split() for line in lines])
    words = {".obj": ("v", "vn"), ".stl": ("vertex", "facet")}[suffix]
    found: dict[str, list[Any]] = {word: [] for word in words}
    rest = []
    for line in lines:
        key, *numbers = line.split() or [""]
        if key.lower() in found:
            found[key.lower()].append(numbers)
        else:
            rest.append(line)
    V, N = (found[word] for word in words)
    start = 1 if suffix == ".stl" else 0  # "facet normal x y z"
    N = np.array([row[start:] for row in N], dtype=float).reshape(-1, 3)
    return Content(np.array([row[:3] for row in V], dtype=float), N, [rest, [row[3:] for row in V]])


def _off(lines: list[list[str]]) -> Content:
    (keyword, *counts), *rows = [words for words in lines if words]
    if not counts:
        counts, *rows = rows
    n = int(counts[0])
    V = np.array([row[:3] for row in rows[:n]], dtype=float)
    more = [row[3:] for row in rows[:n]]
    N = np.array(more, dtype=float) if keyword == "NOFF" else np.zeros((0, 3))
    return Content(V, N, [keyword, counts, more if keyword != "NOFF" else [], rows[n:]])
