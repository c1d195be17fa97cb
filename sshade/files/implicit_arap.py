"""Read handle files of Implicit-ARAP: named parts, in its coordinates."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sshade.core.atomic import naming
from sshade.core.errors import InputError
from sshade.files.handwritten import as_points, decoded, parsed_yaml, require_known

if TYPE_CHECKING:
    from sshade.mesh.mesh import Mesh

#: Largest coordinate of a mesh in the coordinates of Implicit-ARAP.
HALF_EXTENT = 0.8
#: Greatest accepted mean distance between the points and the surface of the mesh, in these coordinates.
ON_SURFACE = 0.01


def read_implicit_arap(path: Path) -> list[tuple[np.ndarray, np.ndarray | None]]:
    """Return the points of each part and their targets, None if the part is fixed, in the file's coordinates.

    D. Baieri, F. Maggioli, Z. Laehner, S. Melzi, E. Rodola, "Implicit-ARAP", 2024.
    """
    data = parsed_yaml(path.read_bytes())
    if not isinstance(data, dict) or not isinstance(data.get("handles"), dict):
        raise InputError("expected a mapping `handles` with `static` and `moving`")
    _check_keys(data["handles"])
    static = _names(data["handles"], "static", "positions")
    moving = _names(data["handles"], "moving", "positions")
    transforms = _names(data["handles"], "moving", "transform")
    if len(moving) != len(transforms):
        raise InputError(f"{len(moving)} moving parts have {len(transforms)} transforms; each needs one")
    if not static and not moving:
        raise InputError("there are no handles; name at least one static or moving part")
    parts: list[tuple[str, str | None]] = [(name, None) for name in static]
    parts += zip(moving, transforms, strict=True)
    found: list[tuple[np.ndarray, np.ndarray | None]] = []
    for name, transform in parts:
        points, target = _read_points(path.parent / "parts", name), None
        if transform is not None:
            target = _read_points(path.parent / "transforms", transform)
            if len(points) != len(target):
                raise InputError(
                    f"part {name} has {len(points)} points, its transform {transform} {len(target)}"
                )
        found.append((points, target))
    return found


def _check_keys(handles: dict[str, Any]) -> None:
    """Raise InputError if a key of the handles is unknown. Implicit-ARAP may read other keys of the file."""
    with naming("`handles`"):
        require_known(handles, ("static", "moving"))
    for kind, known in {"static": ("positions",), "moving": ("positions", "transform")}.items():
        if isinstance(handles.get(kind), dict):
            with naming(f"`handles.{kind}`"):
                require_known(handles[kind], known)


def _names(handles: dict, kind: str, key: str) -> list[str]:
    parts = handles.get(kind) or {}
    names = (parts.get(key) or []) if isinstance(parts, dict) else None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"`handles.{kind}.{key}` must be a list of names")
    return names


def _read_points(folder: Path, name: str) -> np.ndarray:
    path = folder / f"{name}.txt"
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise InputError(f"{name!r} leads out of the folder {folder.name}; name a file in it")
    if not path.is_file():
        raise InputError(f"no such file: {path}")
    try:
        rows = [line.split() for line in decoded(path.read_bytes()).splitlines() if line.strip()]
        values = [[float(word) for word in row] for row in rows]
    except (ValueError, InputError) as error:
        raise InputError(f"{path}: each line needs three numbers ({error})") from error
    return as_points(values, str(path))


def implicit_arap_frame(points: np.ndarray, mesh: Mesh):
    """Return the map from the coordinates of Implicit-ARAP to the coordinates of the mesh.

    Implicit-ARAP centres meshes at the area-weighted centroid of the surface and scales the largest
    coordinate to 0.8. Copies of a model differ in their axes and a little in their centroid. Of the 24
    axis rotations, the map uses the rotation that brings the points nearest to the surface, refined by
    rigid ICP on all points.

    Raises
    ------
    InputError
        When the points do not lie near the surface in any orientation.
    """
    import igl
    from scipy.spatial.transform import Rotation

    from sshade.mesh.rigid import rigid_motion

    barycentres = mesh.V[mesh.F].mean(axis=1)
    centre = (barycentres * mesh.face_areas[:, None]).sum(axis=0) / mesh.area
    scale = HALF_EXTENT / np.abs(mesh.V - centre).max()
    V, F = (mesh.V - centre) * scale, np.array(mesh.F)
    tree = igl.AABB()
    tree.init(V, F)

    def closest(queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        squared, _, nearest = tree.squared_distance(V, F, np.ascontiguousarray(queries))
        return np.sqrt(squared), nearest

    rotations = np.rint(Rotation.create_group("O").as_matrix())
    rotations = rotations[np.argsort(-np.trace(rotations, axis1=1, axis2=2), kind="stable")]
    distance, _ = closest((points @ rotations.transpose(0, 2, 1)).reshape(-1, 3))
    mean = distance.reshape(len(rotations), -1).mean(axis=1)
    R, t, error = rotations[int(np.argmin(mean))], np.zeros(3), float(mean.min())
    for _ in range(2):
        at = points @ R.T + t
        dR, dt = rigid_motion(at, closest(at)[1])
        refined = float(closest(points @ (dR @ R).T + dR @ t + dt)[0].mean())
        if refined >= error:
            break
        R, t, error = dR @ R, dR @ t + dt, refined
    if error >= ON_SURFACE:
        raise InputError(
            f"its points have a mean distance of {error:.3f} from the mesh, of a half-extent of "
            f"{HALF_EXTENT}, in the best of 24 axis orientations (at most {ON_SURFACE} is accepted); "
            "is this the mesh they were made for?"
        )
    return lambda x: (x @ R.T + t) / scale + centre
