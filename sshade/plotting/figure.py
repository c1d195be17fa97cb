"""Figures that turn in a notebook: :func:`plot`."""

from __future__ import annotations

import base64
import gzip
import html
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from string import Template
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from sshade.core.errors import InputError, counted
from sshade.core.whole_files import check_output, replacing
from sshade.files.arrays import Arrays
from sshade.files.objects import mesh_in
from sshade.mesh.mesh import Mesh
from sshade.mesh.surface import Surface, SurfaceFacts, cleaned
from sshade.plotting import COLOURS, part, style, threejs
from sshade.plotting.pictures import CAMERAS, COLOUR_LABELS, colour_range, colour_values
from sshade.plotting.view import ViewShape, packed_view
from sshade.problem.handles import Handles
from sshade.problem.task import DeformationResult, DeformationTask, TransferTask

#: Height of a figure in a notebook, in pixels.
HEIGHT = 520
#: Arguments of :func:`plot`, for messages.
TAKEN = "meshes, positions, handles, tasks and results"


class Figure:
    """A 3D view that turns, zooms and switches between shapes.

    A notebook shows the figure as the value of a cell. The view needs neither a server nor the network.

    Attributes
    ----------
    page : str
        The view as an HTML page.
    """

    def __init__(self, page: str, about: str) -> None:
        self.page, self._about = page, about

    def __repr__(self) -> str:
        return f"<sshade figure of {self._about}; a notebook shows it, and save(path) writes a web page>"

    def _repr_html_(self) -> str:
        # The frame keeps styles, scripts and names of several figures apart. A notebook without trust leaves
        # the frame out and shows the text inside.
        return (
            f'<iframe srcdoc="{html.escape(self.page)}" title="{html.escape(self._about)}" '
            f'sandbox="allow-scripts" loading="lazy" width="100%" height="{HEIGHT}" style="border: 0">'
            "Run this cell, or trust the notebook, to see the figure.</iframe>"
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the figure as a web page that any browser opens, also without a network.

        Parameters
        ----------
        path : path
            A .html file.

        Raises
        ------
        InputError
            On another suffix, or a folder that does not exist or is not writable.
        """
        path = Path(path)
        check_output(path, (".html",))
        with replacing(path) as temporary:
            temporary.write_text(self.page, encoding="utf-8")


def plot(
    *shown: Any,
    names: Sequence[str] = (),
    values: ArrayLike | None = None,
    label: str = "",
    up: Literal["y", "z"] = "y",
) -> Figure:
    """Draw poses of a mesh and their handles in a figure that turns.

    - ``plot(mesh)`` draws a mesh.
    - ``plot(task)`` and ``plot(mesh, handles)`` add handles: blue handles are fixed, yellow handles move to
      pale targets.
    - ``plot(result)`` draws the rest shape and the result. Buttons switch between the two.
    - ``plot(result, other_result)`` and ``plot(mesh, V, other_V)`` compare poses.

    Colours of a pose show how much the edges at each vertex changed their length. A mesh of more than 28,000
    vertices is shown by about 20,000 of its vertices, and the figure says so.

    Parameters
    ----------
    *shown : Mesh, Handles, DeformationTask, TransferTask, DeformationResult or (n, 3) float64
        The first mesh is the rest shape. Further meshes and positions are poses of the mesh. A mesh may be
        given as vertices followed by faces, or as an object of trimesh or pyvista that
        :func:`sshade.deform` takes. Without `Handles`, the handles of the first task are shown.
    names : sequence of str
        Names of the poses after the rest shape; by default "result", or numbers.
    values : (n,) float64, optional
        Values that replace the change of edge length in the colours of all shapes.
    label : str
        Name and unit of the values.
    up : {"y", "z"}
        Axis that points up at first.

    Raises
    ------
    InputError
        On an unknown object, poses or handles of another mesh, a result without a task and without a mesh,
        a wrong number of values or names, or an unknown axis.

    Examples
    --------
    >>> import numpy as np
    >>> import sshade
    >>> V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], dtype=float)
    >>> F = np.array([[0, 1, 2], [0, 2, 3]])
    >>> sshade.plot(V, F, V + [0, 0, 1], names=["raised"])
    <sshade figure of rest and raised; a notebook shows it, and save(path) writes a web page>
    """
    if up not in CAMERAS:
        raise InputError(f'up is "y" or "z", not {up!r}')
    scene, waiting = _Scene(), list(shown)
    while waiting:
        scene.take(waiting.pop(0), waiting)
    mesh = scene.mesh
    if mesh is None:
        raise InputError(f"there is no mesh to plot: plot takes {TAKEN}")
    poses = {pose.name: pose.V for pose in _named(scene.poses, names)}
    if values is None:
        return figure_of(mesh, scene.handles, poses, colour="stretch", camera=CAMERAS[up])
    colours = scene.values(values)
    shapes = [ViewShape(name, "", V, colours) for name, V in {"rest": mesh.V, **poses}.items()]
    bounds = float(colours.min()), float(colours.max())
    return _figure(mesh, scene.handles, shapes, bounds, label, camera=CAMERAS[up])


def figure_of(
    mesh: Mesh,
    handles: Handles | None,
    poses: Mapping[str, np.ndarray],
    *,
    colour: str | None = None,
    **look: Any,
) -> Figure:
    """Return a figure of a rest shape and its poses by name.

    Parameters
    ----------
    mesh : Mesh
    handles : Handles, optional
    poses : mapping of (n, 3) float64
    colour : str, optional
        A key of :data:`sshade.plotting.pictures.COLOUR_LABELS`. By default shapes are plain.
    **look
        `camera`, `size`, `colours` and `skin` of :func:`sshade.plotting.view.packed_view`.

    Raises
    ------
    InputError
        When all vertices coincide.
    """
    shapes, top, label = [ViewShape(name, "", V) for name, V in poses.items()], 1.0, ""
    if colour and shapes:
        values = [colour_values(mesh, shape.V, colour) for shape in shapes]
        top, label = colour_range(values), COLOUR_LABELS[colour]
        shapes = [shape._replace(values=own) for shape, own in zip(shapes, values, strict=True)]
    rest = ViewShape("rest", "", mesh.V)
    return _figure(mesh, handles, [rest, *shapes], (0.0, top), label, **look)


def _figure(
    mesh: Mesh,
    handles: Handles | None,
    shapes: Sequence[ViewShape],
    bounds: tuple[float, float],
    label: str,
    **look: Any,
) -> Figure:
    if mesh.diagonal == 0:
        raise InputError("all vertices of the mesh coincide; there is nothing to see")
    bottom, top = bounds
    top = top if top > bottom else bottom + max(1.0, abs(bottom))
    view = packed_view(mesh, shapes, handles=handles, bottom=bottom, top=top, label=label, **look)
    return Figure(_page(view), " and ".join(shape.name for shape in shapes))


class _Scene:
    """The mesh, the poses and the handles among the arguments of :func:`plot`."""

    def __init__(self) -> None:
        self.mesh: Mesh | None = None
        self.handles: Handles | None = None
        self.poses: list[ViewShape] = []
        #: Number of vertices and faces of the first object, and the mesh in it.
        self._n, self._F = 0, np.zeros((0, 3), dtype=np.int64)
        self._whole: Surface
        self._chosen = False

    def take(self, one: Any, following: list[Any]) -> None:
        """Take an argument. Faces that follow vertices are taken with the vertices, and leave `following`."""
        if isinstance(one, Handles):
            self._add_handles(one)
        elif isinstance(one, DeformationTask | TransferTask):
            self._add_task(one)
            if one.truth is not None:
                self._add_pose("truth", one.truth)
        elif isinstance(one, DeformationResult):
            if one.task is not None:
                self._add_task(one.task)
            self._add_pose("result", one.vertices)
        elif isinstance(one, Mesh):
            self._add_mesh(one.V, one.F, one)
        elif isinstance(one, Arrays):
            self._add_mesh(one.V, one.F)
        elif (shape := mesh_in(one)) is not None:
            self._add_mesh(shape.V, shape.F)
        elif (V := _numbers(one)) is not None:
            F = _numbers(following[0]) if following else None
            if F is not None and F.dtype.kind in "iu" and (self.mesh is None or np.array_equal(F, self._F)):
                self._add_mesh(V, F)
                del following[0]
            else:
                self._add_pose("pose", V)
        else:
            raise InputError(f"plot takes {TAKEN}, not an object of type {type(one).__name__}")

    def values(self, values: ArrayLike) -> np.ndarray:
        """Return values of the vertices of the first object as values (n,) of the mesh."""
        array = _numbers(values)
        if array is None or array.shape != (self._n,) or not np.isfinite(array).all():
            given = "other objects" if array is None else f"an array {array.shape}, or one with NaN"
            raise InputError(
                f"values are one finite number for each of the {self._n:,} vertices, not {given}"
            )
        return array[self._whole.vertex >= 0].astype(np.float64)

    def _add_mesh(self, V: np.ndarray, F: np.ndarray, mesh: Mesh | None = None) -> None:
        if self.mesh is not None:
            self._require_faces(V, F, "a further mesh")
            self._add_pose("pose", V)
            return
        self._whole = cleaned(V, F) if mesh is None else Surface(mesh, np.arange(mesh.n), SurfaceFacts())
        self.mesh, self._n, self._F = self._whole.mesh, len(V), np.asarray(F)

    def _add_task(self, task: DeformationTask | TransferTask) -> None:
        rest = task.mesh
        if self.mesh is None:
            self._add_mesh(rest.V, rest.F, rest)
        elif rest is not self.mesh:
            self._require_faces(rest.V, rest.F, "the mesh of a task or result")
            if not np.array_equal(rest.V, self.mesh.V):
                raise InputError("the mesh of a task or result is not the rest shape that comes first")
        if isinstance(task, DeformationTask) and self.handles is None:
            self.handles = task.handles

    def _require_faces(self, V: np.ndarray, F: np.ndarray, name: str) -> None:
        if len(V) != self._n or not (F is self._F or np.array_equal(F, self._F)):
            raise InputError(
                f"{name} has {len(V):,} vertices and {len(F):,} faces, and the first mesh "
                f"{self._n:,} and {len(self._F):,}, or the faces differ: a figure shows poses of "
                "one mesh, so plot other meshes by themselves"
            )

    def _add_pose(self, name: str, V: np.ndarray) -> None:
        if self.mesh is None:
            before = "it knows no task" if name == "result" else "no faces follow it"
            raise InputError(f"the mesh of a {name} is missing, because {before}: pass the mesh first")
        if V.shape != (self._n, 3):
            raise InputError(
                f"a {name} has shape {V.shape}, and the mesh {self._n:,} vertices: pass poses of one mesh"
            )
        self.poses.append(ViewShape(name, "", self.mesh.checked(V[self._whole.vertex >= 0], name)))

    def _add_handles(self, handles: Handles) -> None:
        if self.mesh is None:
            raise InputError("the mesh of the handles is missing: pass the mesh first")
        if self._chosen:
            raise InputError("a figure shows one object of handles, and two were passed")
        index = self._whole.places(handles.index)
        self.handles, self._chosen = replace(handles, index=index, extent=self.mesh.diagonal), True


def _numbers(one: Any) -> np.ndarray | None:
    """Return an array or nested lists of numbers as an array; None for other objects."""
    if not isinstance(one, np.ndarray | list | tuple):
        return None
    with suppress(ValueError, TypeError):
        array = np.asarray(one)
        return array if array.dtype.kind in "iuf" else None
    return None


def _named(poses: list[ViewShape], names: Sequence[str]) -> list[ViewShape]:
    """Return poses with unique names: the given ones, or their kinds with numbers."""
    if names:
        chosen = list(names)
        if len(chosen) != len(poses) or isinstance(names, str):
            follow = counted(len(poses), "pose follows", "poses follow")
            raise InputError(f"{follow} the rest shape, and names has {len(chosen)}")
    else:
        kinds = [pose.name for pose in poses]
        count = {kind: kinds.count(kind) for kind in kinds}
        chosen = [
            f"{kind} {kinds[:i].count(kind) + 1}" if count[kind] > 1 else kind for i, kind in enumerate(kinds)
        ]
    if len({"rest", *chosen}) <= len(chosen):
        raise InputError(f'names of poses differ from each other and from "rest", unlike {chosen}')
    return [pose._replace(name=str(name)) for pose, name in zip(poses, chosen, strict=True)]


def _page(view: dict[str, Any]) -> str:
    """Return the page of a packed view."""
    data = view.pop("data")
    cases = json.dumps({"cases": [{**view, "id": "figure", "title": ""}]})
    return Template(part("figure.html")).substitute(
        style=style(),
        view=part("view.html"),
        ramp=COLOURS,
        cases=cases.replace("<", "\\u003c"),  # no text may end the element
        data=data,
        scripts=_scripts(),
    )


@cache
def _scripts() -> str:
    """Return three.js and the script of the view, compressed, as base64."""
    text = f"{threejs.source()}\n{part('viewer.js')}"
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode("ascii")
