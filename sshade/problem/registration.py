"""Register points in the coordinates of Implicit-ARAP to a mesh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion

#: Largest coordinate of a mesh in the coordinates of Implicit-ARAP.
HALF_EXTENT = 0.8
#: Greatest accepted mean distance between the points and the surface of the mesh, in these coordinates.
ON_SURFACE = 0.01


def implicit_arap_frame(points: np.ndarray, mesh: Mesh) -> Callable[[np.ndarray], np.ndarray]:
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
