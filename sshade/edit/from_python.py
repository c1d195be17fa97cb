"""Open the editor from Python, and return the handles that the user makes."""

from __future__ import annotations

import webbrowser
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sshade.core.errors import InputError
from sshade.edit.server import Server
from sshade.edit.session import Session
from sshade.edit.state import METHODS, Settings
from sshade.files.door import open_shape
from sshade.files.objects import mesh_in
from sshade.mesh.mesh import Mesh
from sshade.problem.handles import Handles
from sshade.problem.options import require_method

#: Largest time in seconds for a computation to end before the function does.
PATIENCE = 10.0


def edit_handles(
    mesh: Any,
    handles: Handles | None = None,
    *,
    method: str = "fast",
    refuse_unconstrained: bool = False,
    up: Literal["y", "z"] = "y",
    port: int = 0,
) -> Handles:
    """Open the editor in a browser, wait until the user ends it, and return the handles.

    The user ends the editor by *Return to Python* on its page. An interrupt of Python also ends it and
    returns the handles. If Python is killed, a recovery file in the current folder keeps the handles: the
    next call with the same mesh offers it. The address of the page is printed. Only this machine can open it.

    Parameters
    ----------
    mesh : Mesh, trimesh.Trimesh, trimesh.Scene or pyvista.PolyData
        The mesh at rest, as :func:`sshade.deform` takes it.
    handles : Handles, optional
        Handles to begin with.
    method : {"fast", "fine", "paper"}
        Method with which the page shows the mesh at first.
    refuse_unconstrained : bool
        See :class:`sshade.DeformationTask`.
    up : {"y", "z"}
        Axis that points up at first.
    port : int
        Port of the page, by default any free port. Choose a port to forward it from another machine.

    Returns
    -------
    Handles
        At vertices of `mesh`, a group for each group of the page. All copies of a vertex along a seam have a
        handle.

    Raises
    ------
    InputError
        On another object, handles that are no vertices of the mesh, an unknown method or axis, a port that
        cannot be used, or when the user made no handles.
    """
    found = mesh_in(mesh)
    if found is None:
        raise InputError(
            f"edit_handles takes a mesh, not an object of type {type(mesh).__name__}; of arrays make "
            "sshade.Mesh(V, F)"
        )
    if up not in ("y", "z"):
        raise InputError(f'up is "y" or "z", not {up!r}')
    if not isinstance(handles, Handles | None):
        raise InputError(f"handles are an sshade.Handles, not an object of type {type(handles).__name__}")
    settings = Settings(require_method(method, METHODS))
    is_mesh = isinstance(mesh, Mesh)  # arrays of other objects may change later, and are copied
    V, F = (array if is_mesh else np.array(array) for array in (found.V, found.F))
    for array in (V, F):
        array.setflags(write=False)  # so that Mesh need not copy it again
    digest = blake2b(np.ascontiguousarray(V).tobytes() + np.ascontiguousarray(F).tobytes(), digest_size=3)
    path = Path.cwd() / f"mesh_{digest.hexdigest()}.ply"
    session = Session(
        path,
        shape=open_shape(V, F),
        handles=handles,
        settings=settings,
        refuse_unconstrained=refuse_unconstrained,
    )
    server = Server(session, port=port, up=up)
    try:
        with server:
            text = f"The editor is open at {server.address} until you click Return to Python on its page."
            print(text, flush=True)  # noqa: T201
            webbrowser.open(server.address)
            with suppress(KeyboardInterrupt):  # a notebook ends a cell like this
                server.serve_forever(poll_interval=0.1)
            server.close()
        return session.hand_over()
    finally:
        session.end(PATIENCE)
