"""Save and load bindings: the .npz maps that `sshade remesh` writes and `sshade carry` reads."""

from __future__ import annotations

import hashlib
import os
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.core.whole_files import INCOMPLETE, expecting, naming, read_npz, replacing
from sshade.mesh.mesh import Mesh, require_mesh
from sshade.proxy.binding import Binding, FrameKind, bind_proxy, frame_maker
from sshade.proxy.frames import FrameMaker
from sshade.proxy.sample import Sampling
from sshade.proxy.triangle import TriangleFrames

#: What a file of a binding is, in messages.
WHAT = "a map written by `sshade remesh`"


def save_binding(path: str | os.PathLike[str], binding: Binding) -> None:
    """Write a binding as .npz, without the mesh itself; :func:`load_binding` reads it back.

    The file appears whole or not at all.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    frames, sampling = binding.frames, binding.sampling
    arrays: dict[str, Any] = {
        "samples": sampling.samples,
        "faces": sampling.faces,
        "region": sampling.cell,
        "distance": sampling.distance,
        "vertices": len(binding.local),
        "mesh": _digest(binding.mesh.F),
        "frames": frames.name,
    }
    if isinstance(frames, TriangleFrames):
        arrays["values"] = frames.values
    with replacing(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, **arrays)


def load_binding(
    path: str | os.PathLike[str], mesh: Mesh, *, frames: FrameKind | FrameMaker | None = None
) -> Binding:
    """Read a binding written by :func:`save_binding`.

    Parameters
    ----------
    path : path
    mesh : Mesh
        The mesh that the binding was made for. It is projected onto the proxy anew.
    frames : {"triangle", "blended"} or FrameMaker, optional
        Kind of frames; by default the saved kind. ``triangle`` frames use the saved frame function, or the
        default function if other frames were saved.

    Raises
    ------
    InputError
        If the file is unreadable, incomplete, made for a mesh with other counts or faces, or with frames of
        another kind while `frames` is left out.
    """
    require_mesh(mesh, "load_binding")
    arrays = read_npz(path, what=WHAT)
    with expecting(WHAT, path, errors=INCOMPLETE), naming(path):
        remedy = "remesh this one, or pass the --weld and --repair that `sshade remesh` got"
        if arrays["vertices"] != mesh.n:
            vertices = arrays["vertices"]
            raise InputError(
                f"the map is of a mesh with {vertices} vertices, this one has {mesh.n}; {remedy}"
            )
        if str(arrays["mesh"]) != _digest(mesh.F):
            raise InputError(f"the map is of a mesh with other faces; {remedy}")
        sampling = Sampling(
            arrays["samples"], arrays["faces"], cell=arrays["region"], distance=arrays["distance"]
        )
        kind, values = frames or str(arrays["frames"]), arrays.get("values")
        _require_fit(sampling, values, mesh.n)
        if kind == "triangle" and values is not None:
            return bind_proxy(mesh, sampling, frames=lambda proxy, _: TriangleFrames.of_values(proxy, values))
        return bind_proxy(mesh, sampling, frames=frame_maker(kind))  # type: ignore[arg-type]


def _digest(F: np.ndarray) -> str:
    return hashlib.sha256(F.tobytes()).hexdigest()


def _require_fit(sampling: Sampling, values: np.ndarray | None, n: int) -> None:
    """Raise ValueError unless the arrays of a map fit together; kernels would read out of bounds."""
    k, faces = len(sampling.samples), len(sampling.faces)
    expected = [
        (sampling.samples, (k,), n),
        (sampling.faces, (faces, 3), k),
        (sampling.cell, (n,), k),
        (sampling.distance, (n,), None),
    ]
    if values is not None:
        expected.append((values, (faces, 3), None))
    for array, shape, end in expected:
        if end is None:
            valid = array.dtype == np.float64 and np.isfinite(array).all()
        else:
            valid = array.dtype.kind == "i" and array.min() >= 0 and array.max() < end
        if array.shape != shape or not valid:
            raise ValueError("its arrays do not fit together")
