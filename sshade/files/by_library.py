"""Meshes in files that libraries read and write: trimesh 3MF, COLLADA and XYZ, and PyVista those of VTK.

All points of a file are vertices, in the order of the file. Its surface gives the faces: polygons become
triangles, and cells with a volume their outer sides.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sshade.core.console import how_to_install
from sshade.core.errors import InputError
from sshade.core.whole_files import check_suffix
from sshade.files.mesh_file import DECLARED, SUFFIXES, MeshFile, check_input, present

#: Modules that a format needs, by its suffix. An extra has a name and brings them all.
FORMATS = {".3mf": ("trimesh", "networkx", "lxml"), ".dae": ("trimesh", "collada"), ".xyz": ("trimesh",)}
FIGURES = dict.fromkeys((".vtp", ".vtu", ".vtk"), ("pyvista",))
EXTRA = dict.fromkeys(FORMATS, "formats") | dict.fromkeys(FIGURES, "figures")
#: Suffixes of all meshes that are read and written, some of them by libraries. A file .xyz has no faces.
READABLE = (*SUFFIXES, *EXTRA)
WRITABLE = tuple(suffix for suffix in READABLE if suffix != ".xyz")
#: Methods of data sets of VTK that return cells with ids of points.
CELLS = ("GetPolys", "GetStrips", "GetCells")
#: Parts of a COLLADA file that trimesh leaves out, with the meshes that they move.
RIGGED = re.compile(rb"<(?:\w+:)?(skin|morph)\s")
NO_RIG = "which cannot be deformed: apply the pose, and export without the skeleton and the morph targets"
#: Units that trimesh writes.
UNITS = {".3mf": ("millimeter", "millimeters"), ".dae": ("meters",)}


def check_mesh(path: Path) -> None:
    """Raise InputError unless `path` is a file with the suffix of a mesh."""
    own, formats, figures = map(", ".join, (SUFFIXES, FORMATS, FIGURES))
    listing = f"{own}, with the extra formats {formats}, or with the extra figures {figures}"
    check_suffix(path, READABLE, listing=listing)
    check_input(path, READABLE)


def require_libraries(path: Path) -> None:
    """Raise InputError if the format of `path` needs a library that is not installed."""
    suffix = path.suffix.lower()
    for name in (FORMATS | FIGURES).get(suffix, ()):
        try:
            import_module(name)
        except ModuleNotFoundError as error:
            raise InputError(f"{path}: {name} is not installed; {how_to_install(EXTRA[suffix])}") from error


def read_by_library(path: Path) -> MeshFile:
    """Read a file whose format needs a library.

    Raises
    ------
    Exception
        When the library is not installed, or cannot read the file.
    """
    require_libraries(path)
    return _with_pyvista(path) if path.suffix.lower() in FIGURES else _with_trimesh(path)


def write_by_library(path: Path, V: np.ndarray, F: np.ndarray) -> None:
    """Write positions (n, 3) and triangles (m, 3) in a format that needs a library."""
    require_libraries(path)
    suffix = path.suffix.lower()
    if suffix in FIGURES:
        import pyvista

        mesh = pyvista.PolyData.from_regular_faces(V, F)
        (mesh.cast_to_unstructured_grid() if suffix == ".vtu" else mesh).save(path)
    else:
        import trimesh

        trimesh.Trimesh(V, F, process=False).export(path, file_type=suffix[1:])


def _with_trimesh(path: Path) -> MeshFile:
    """Read the meshes of all nodes, one after another, where the scene shows them."""
    import trimesh

    from sshade.mesh.surface import single_steps  # imports large libraries

    suffix = path.suffix.lower()
    if suffix == ".dae" and (held := RIGGED.search(path.read_bytes())):
        raise InputError(f"{path}: it holds {'a skin' if held[1] == b'skin' else 'morph targets'}, {NO_RIG}")
    if suffix == ".dae":  # meshes without a material would be left out
        scene = trimesh.load_scene(path, process=False, ignore_broken=False)
    else:
        scene = trimesh.load_scene(path, process=False)
    V, F = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    kinds = set()
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name].copy()
        mesh.apply_transform(matrix)
        F = np.concatenate([F, len(V) + np.asarray(getattr(mesh, "faces", F[:0]))])
        V = np.concatenate([V, mesh.vertices])
        kinds.add(mesh.visual.kind)
    holds = present(
        objects=len(scene.graph.nodes_geometry) > 1,
        materials="texture" in kinds,
        colours=len(F) and kinds & {"vertex", "face"},  # points always have colours in trimesh
        unit_of_length=scene.units not in UNITS.get(suffix, (None,)),
    )
    rounding = single_steps(V) if suffix == ".dae" else None  # pycollada reads float32
    return MeshFile(V, F, holds, () if holds else (suffix,), _anew(F), rounding=rounding, stored=None)


def _with_pyvista(path: Path) -> MeshFile:
    """Read the surface of a data set. Data at the points and cells of triangles alone are written again."""
    import pyvista

    from sshade.files.objects import mesh_in, outer_triangles  # imports large libraries
    from sshade.mesh.surface import single_steps

    with pyvista.vtk_verbosity("off"), pyvista.VtkErrorCatcher(send_to_logging=False) as caught:
        reader = pyvista.get_reader(path).reader
        reader.Update()
        data = pyvista.wrap(reader.GetOutputDataObject(0))
    for event in caught.events:  # VTK goes on after an error, with numbers that are not in the file
        if event.kind == "ERROR" or "Error" in event.alert:
            raise ValueError(event.alert.splitlines()[-1])
    for cells in (getattr(data, name)() for name in CELLS if hasattr(data, name)):
        ids = pyvista.convert_array(cells.GetConnectivityArray())
        if ids.min(initial=0) < 0 or ids.max(initial=-1) >= data.n_points:  # VTK would read any memory
            raise ValueError(f"a cell has a point with an id outside of 0 to {data.n_points - 1}")
    V, is_surface = np.array(data.points, dtype=np.float64), isinstance(data, pyvista.PolyData)
    rounding = single_steps(V) if data.points.dtype == np.float32 else None
    F, all_triangles = outer_triangles(data)
    of_points, of_cells, space = data.point_data, data.cell_data, ""
    title = reader.GetHeader() if path.suffix.lower() == ".vtk" else ""
    if declared := DECLARED.search(title.encode()):
        space = declared[1].decode()
    elif "SPACE" in data.field_data:
        space = str(data.field_data["SPACE"][0])
    holds = present(
        point_data=len(of_points), cell_data=len(of_cells), other_cells_than_triangles=not all_triangles
    )
    if is_surface and all_triangles and (found := mesh_in(data)):

        def content(posed: np.ndarray, output: Path) -> bytes:
            moved = found.moved(posed)
            if output.suffix.lower() == ".vtk":
                version, usual, rest = _bytes(output, moved.save).split(b"\n", 2)
                declared = f"SPACE={space}".encode() if space else usual
                return b"\n".join([version, title.encode() or declared, rest])
            if space:
                moved.field_data["SPACE"] = [space]
            return _bytes(output, moved.save)

        return MeshFile(V, F, holds, (".vtp", ".vtk"), content, rounding=rounding, space=space)
    suffixes = () if holds or space else (path.suffix.lower(),)
    return MeshFile(V, F, holds, suffixes, _anew(F), rounding=rounding, stored=None, space=space)


def _anew(F: np.ndarray) -> Callable[[np.ndarray, Path], bytes]:
    """Return the `content` of a :class:`MeshFile` with triangles F (m, 3) that is written anew."""
    return lambda V, output: _bytes(output, lambda file: write_by_library(file, V, F))


def _bytes(output: Path, write: Callable[[Path], None]) -> bytes:
    """Return what `write` writes into a file with the suffix of `output`."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / f"mesh{output.suffix.lower()}"
        write(file)
        return file.read_bytes()
