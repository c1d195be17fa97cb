"""PLY files of points without faces: point clouds, and scenes of 3D Gaussian splats.

A splat is a Gaussian with the covariance R S^2 R^T. The file has S as logarithms ``scale_*``, R as a
quaternion ``rot_*`` (w, x, y, z) of any length, and a colour that depends on the direction of view, in
spherical harmonics ``f_dc_*`` and ``f_rest_*``. Under a linear map J the covariance becomes J R S^2 R^T J^T.
Its new R and S come from the columns of J R S, which plane rotations make orthogonal. If J is a rotation, the
columns are orthogonal already, and S stays. The harmonics of the bands 1 to 3 turn by the rotation nearest
to J. All other properties stay.

Sources: B. Kerbl, G. Kopanas, T. Leimkuehler, G. Drettakis, "3D Gaussian splatting for real-time radiance
field rendering", 2023 (the file, and the signs of its harmonics); M. R. Hestenes, "Inversion of matrices by
biorthogonalization and related results", 1958 (orthogonal columns by plane rotations).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sshade.errors import InputError
from sshade.io.files import check_output, replacing
from sshade.io.normals import turned
from sshade.io.ply import NORMALS, Change, Ply, changed, parsed
from sshade.kernels import kernel, subroutine
from sshade.threads import in_ranges

_PLACE, _SCALE, _ROTATION = "x y z", "scale_0 scale_1 scale_2", "rot_0 rot_1 rot_2 rot_3"
#: Number of coefficients of a colour channel behind the constant, for 0 to 3 bands.
BANDS = (0, 3, 8, 15)
#: Largest product of two columns, over their lengths, that counts as orthogonal; largest number of sweeps.
ORTHOGONAL, SWEEPS = 1e-14, 12
#: Least length of a column, as a fraction of the longest: shorter columns have no direction.
COLLAPSED = 1e-30


@dataclass(frozen=True, eq=False)
class PointFile:
    """Points of a PLY file without faces; :func:`read_points` makes one.

    Attributes
    ----------
    path : path
    ply : Ply
    V : (n, 3) float64
        Positions.
    is_splats : bool
    """

    path: Path
    ply: Ply
    V: np.ndarray
    is_splats: bool

    def write(self, path: Path, positions: np.ndarray, rotations: np.ndarray, maps: np.ndarray) -> None:
        """Write the file with moved points. It appears whole or not at all.

        Parameters
        ----------
        path : path
        positions : (n, 3) float64
        rotations, maps : (n, 3, 3) float64
            Rotation and linear map at each point; see :class:`sshade.PosedPoints`.

        Raises
        ------
        InputError
            On another suffix than .ply, or a folder that does not exist or is not writable.
        """
        path = Path(path)
        check_output(path, (".ply",))
        vertices = self.ply.elements["vertex"]
        changes: list[Change] = [(vertices, vertices.numbers(_PLACE), positions)]
        for normals in filter(None, map(vertices.numbers, NORMALS)):
            changes.append((vertices, normals, turned(rotations, vertices.columns(normals))))
        if self.is_splats:
            shapes = vertices.numbers(f"{_ROTATION} {_SCALE}")
            changes.append((vertices, shapes, moved_shapes(vertices.columns(shapes), maps)))
            if coefficients := _harmonics(vertices.properties):
                new = turned_harmonics(vertices.columns(coefficients), rotations)
                changes.append((vertices, coefficients, new))
        content = changed(self.ply, changes, self.path, path)
        with replacing(path) as temporary:
            temporary.write_bytes(content)


def read_points(path: Path) -> PointFile | None:
    """Read a PLY file of points or splats; return None if it has faces.

    Raises
    ------
    InputError
        When a file has splats of another layout: compressed, with other scales than three or other rotations
        than quaternions, or with another number of harmonics.
    ValueError
        When the file is no PLY file with positions.
    """
    ply = parsed(path.read_bytes())
    vertices = ply.elements.get("vertex")
    if vertices is None:
        raise ValueError("it has no vertices")
    names = {p.name for p in vertices.properties}
    if "packed_position" in names:
        raise InputError(f"{path}: holds compressed splats; export them as a plain PLY file with x, y and z")
    if any(name in ply.elements and ply.elements[name].size for name in ("face", "tristrips")):
        return None
    numbers = vertices.numbers(_PLACE)
    if not numbers:
        raise ValueError("its vertices have no x, y and z")
    whole = [p.name for p in vertices.properties if p.kind.kind != "f" and p.name in _PLACE.split()]
    if whole:
        raise InputError(f"{path}: its coordinates are integers; save them as floating-point numbers")
    is_splats = any(name.startswith(("scale_", "rot_", "f_dc_", "f_rest_")) for name in names)
    if is_splats:
        for text in (_SCALE, _ROTATION):
            there = sorted(name for name in names if name.startswith(text.split("_")[0] + "_"))
            if there != text.split() or not vertices.numbers(text):
                found = ", ".join(there) or "none"
                raise InputError(
                    f"{path}: splats need {text.replace(' ', ', ')}, and the file has {found}; "
                    "export them in the layout of 3D Gaussian splatting"
                )
        _harmonics(vertices.properties, path)
    return PointFile(path, ply, vertices.columns(numbers), is_splats)


def _harmonics(properties: list, path: Path | None = None) -> list[int]:
    """Return the numbers of the properties f_rest_0, f_rest_1, ...; raise InputError on another number."""
    place = {p.name: i for i, p in enumerate(properties) if p.name.startswith("f_rest_")}
    names = [f"f_rest_{i}" for i in range(len(place))]
    if len(place) not in [3 * count for count in BANDS] or set(names) != set(place):
        raise InputError(
            f"{path}: has {len(place)} properties f_rest_*; splats have 0, 9, 24 or 45, counted from 0"
        )
    return [place[name] for name in names]


def moved_shapes(shapes: np.ndarray, maps: np.ndarray) -> np.ndarray:
    """Return quaternions and logarithms of scales (n, 7) of splats under linear maps (n, 3, 3).

    Quaternions keep their lengths. A scale of 0 stays.
    """
    new = np.array(shapes, dtype=np.float64, order="C")
    maps = np.ascontiguousarray(maps)
    in_ranges(lambda first, end: _move_shapes(first, end, new, maps), len(new))
    return new


def turned_harmonics(coefficients: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Return coefficients (n, 3 k) of the functions of the direction d whose values at R d are those at d.

    Parameters
    ----------
    coefficients : (n, 3 k) float64
        k = 3, 8 or 15 coefficients of the bands from 1 on, for each of three colour channels in turn.
    rotations : (n, 3, 3) float64
    """
    new = np.array(coefficients, dtype=np.float64, order="C")
    rotations = np.ascontiguousarray(rotations)
    tables = DIRECTIONS, INVERSE[0], INVERSE[1], INVERSE[2]
    in_ranges(lambda first, end: _turn_harmonics(first, end, new, rotations, *tables), len(new))
    return new


@subroutine
def harmonics(x, y, z, out):
    """Write the 15 harmonics of the bands 1 to 3 at a unit vector, with the signs of splat files."""
    xx, yy, zz = x * x, y * y, z * z
    out[0], out[1], out[2] = -0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x
    out[3], out[4] = 1.0925484305920792 * x * y, -1.0925484305920792 * y * z
    out[5] = 0.31539156525252005 * (2.0 * zz - xx - yy)
    out[6], out[7] = -1.0925484305920792 * x * z, 0.5462742152960396 * (xx - yy)
    out[8] = -0.5900435899266435 * y * (3.0 * xx - yy)
    out[9] = 2.890611442640554 * x * y * z
    out[10] = -0.4570457994644658 * y * (4.0 * zz - xx - yy)
    out[11] = 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy)
    out[12] = -0.4570457994644658 * x * (4.0 * zz - xx - yy)
    out[13] = 1.445305721320277 * z * (xx - yy)
    out[14] = -0.5900435899266435 * x * (xx - 3.0 * yy)


def _tables() -> tuple[np.ndarray, list[np.ndarray]]:
    """Return seven directions, and matrices from values at 3, 5 or 7 of them to coefficients of a band."""
    z = np.array([0.9, -0.55, 0.1, 0.65, -0.85, 0.4, -0.2])
    angle = 2.399963 * np.arange(7)  # apart by the golden angle
    r = np.sqrt(1 - z * z)
    directions = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    values = np.empty((7, 15))
    for row, (a, b, c) in zip(values, directions, strict=True):
        harmonics.py_func(a, b, c, row)
    slices = (slice(0, 3), slice(3, 8), slice(8, 15))
    return directions, [np.linalg.inv(values[: 2 * band + 3, own]) for band, own in enumerate(slices)]


DIRECTIONS, INVERSE = _tables()


@kernel
def _turn_harmonics(first, end, C, R, directions, one, two, three):
    """Evaluate the functions at the directions turned back, and fit each band to the values."""
    count = C.shape[1] // 3
    Y, value = np.empty((7, 15)), np.empty(7)
    for i in range(first, end):
        used = 3 if count == 3 else 5 if count == 8 else 7
        for k in range(used):
            a, b, c = directions[k, 0], directions[k, 1], directions[k, 2]
            x = R[i, 0, 0] * a + R[i, 1, 0] * b + R[i, 2, 0] * c
            y = R[i, 0, 1] * a + R[i, 1, 1] * b + R[i, 2, 1] * c
            z = R[i, 0, 2] * a + R[i, 1, 2] * b + R[i, 2, 2] * c
            harmonics(x, y, z, Y[k])
        for channel in range(3):
            at, begin = channel * count, 0
            for band in range(3):
                size = 2 * band + 3
                if begin >= count:
                    break
                inverse = one if band == 0 else two if band == 1 else three
                for k in range(size):
                    value[k] = 0.0
                    for j in range(size):
                        value[k] += Y[k, begin + j] * C[i, at + begin + j]
                for j in range(size):
                    total = 0.0
                    for k in range(size):
                        total += inverse[j, k] * value[k]
                    C[i, at + begin + j] = total
                begin += size


@kernel
def _move_shapes(first, end, Q, J):
    B, norm, kept = np.empty((3, 3)), np.empty(3), np.empty(3, dtype=np.bool_)
    for i in range(first, end):
        w, x, y, z = Q[i, 0], Q[i, 1], Q[i, 2], Q[i, 3]
        squared = w * w + x * x + y * y + z * z
        length = np.sqrt(squared)
        if not 0.0 < length < np.inf or np.isnan(Q[i, 4:7]).any():
            continue
        s = 2.0 / squared
        R00, R01, R02 = 1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)
        R10, R11, R12 = s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)
        R20, R21, R22 = s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)
        largest = max(Q[i, 4], Q[i, 5], Q[i, 6])
        for r in range(3):
            a, b, c = J[i, r, 0], J[i, r, 1], J[i, r, 2]
            # Scales are relative to the largest one. A lower bound keeps the directions of flat splats.
            B[r, 0] = (a * R00 + b * R10 + c * R20) * np.exp(max(Q[i, 4] - largest, -30.0))
            B[r, 1] = (a * R01 + b * R11 + c * R21) * np.exp(max(Q[i, 5] - largest, -30.0))
            B[r, 2] = (a * R02 + b * R12 + c * R22) * np.exp(max(Q[i, 6] - largest, -30.0))
        _orthogonalise(B)
        for c in range(3):
            norm[c] = np.sqrt(B[0, c] ** 2 + B[1, c] ** 2 + B[2, c] ** 2)
        longest = max(norm[0], norm[1], norm[2])
        if not (0.0 < longest < np.inf and np.isfinite(norm).all()):
            continue
        for c in range(3):
            kept[c] = norm[c] > COLLAPSED * longest
            if kept[c]:
                B[0, c], B[1, c], B[2, c] = B[0, c] / norm[c], B[1, c] / norm[c], B[2, c] / norm[c]
                cut = min(Q[i, 4 + c] - largest, -30.0) + 30.0 if Q[i, 4 + c] - largest < -30.0 else 0.0
                Q[i, 4 + c] = np.log(norm[c]) + largest + cut
            else:
                Q[i, 4 + c] = min(Q[i, 4 + c], np.log(longest) + largest - 30.0)
        _complete(B, kept)
        right = B[0, 0] * (B[1, 1] * B[2, 2] - B[2, 1] * B[1, 2])
        right -= B[1, 0] * (B[0, 1] * B[2, 2] - B[2, 1] * B[0, 2])
        right += B[2, 0] * (B[0, 1] * B[1, 2] - B[1, 1] * B[0, 2])
        if right < 0.0:
            B[0, 2], B[1, 2], B[2, 2] = -B[0, 2], -B[1, 2], -B[2, 2]
        _to_quaternion(B, Q[i], length)


@subroutine
def _complete(B, kept):
    """Make the columns of B that are not kept, but at least one is, orthonormal to the others."""
    for c in range(3):
        if kept[c]:
            continue
        p, q = (c + 1) % 3, (c + 2) % 3
        x, y, z = 0.0, 0.0, 0.0
        if kept[p] and kept[q]:
            x, y, z = B[0, q], B[1, q], B[2, q]
        else:
            p = p if kept[p] else q
            x = 1.0 if abs(B[0, p]) < 0.6 else 0.0  # one of two coordinates of a unit vector is smaller
            y = 1.0 - x
        x, y, z = B[1, p] * z - B[2, p] * y, B[2, p] * x - B[0, p] * z, B[0, p] * y - B[1, p] * x
        length = np.sqrt(x * x + y * y + z * z)
        B[0, c], B[1, c], B[2, c] = x / length, y / length, z / length
        kept[c] = True


@subroutine
def _orthogonalise(B):
    """Make the columns of B orthogonal by plane rotations from the right."""
    for _ in range(SWEEPS):
        largest = 0.0
        for p, q in ((0, 1), (0, 2), (1, 2)):
            a = B[0, p] * B[0, p] + B[1, p] * B[1, p] + B[2, p] * B[2, p]
            b = B[0, q] * B[0, q] + B[1, q] * B[1, q] + B[2, q] * B[2, q]
            g = B[0, p] * B[0, q] + B[1, p] * B[1, q] + B[2, p] * B[2, q]
            bound = np.sqrt(a * b)
            if bound == 0.0 or not abs(g) > ORTHOGONAL * bound:
                continue
            largest = max(largest, abs(g) / bound)
            zeta = (b - a) / (2.0 * g)
            t = 1.0 / (abs(zeta) + np.sqrt(1.0 + zeta * zeta))
            t = t if zeta >= 0.0 else -t
            c = 1.0 / np.sqrt(1.0 + t * t)
            s = c * t
            for r in range(3):
                B[r, p], B[r, q] = c * B[r, p] - s * B[r, q], s * B[r, p] + c * B[r, q]
        if largest == 0.0:
            break


@subroutine
def _to_quaternion(R, q, length):
    """Write the quaternion of a rotation, with a given length, to q[:4]."""
    a, b, c = R[0, 0], R[1, 1], R[2, 2]
    x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    xy, xz, yz = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    if a + b + c > 0.0:
        w, x, y, z = 1.0 + a + b + c, x, y, z
    elif a >= b and a >= c:
        w, x, y, z = x, 1.0 + a - b - c, xy, xz
    elif b >= c:
        w, x, y, z = y, xy, 1.0 - a + b - c, yz
    else:
        w, x, y, z = z, xz, yz, 1.0 - a - b + c
    scale = length / np.sqrt(w * w + x * x + y * y + z * z)
    if w * q[0] + x * q[1] + y * q[2] + z * q[3] < 0.0:  # of the two signs, the one nearer to the old numbers
        scale = -scale
    q[0], q[1], q[2], q[3] = scale * w, scale * x, scale * y, scale * z
