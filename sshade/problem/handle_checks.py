"""Checks of handles that need no mesh."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sshade.core.errors import InputError, counted

#: Largest difference between two equal targets of one vertex, as a fraction of the diagonal.
SAME_TARGET = 1e-6

#: Largest entry of R R^T - 1 for a rotation R, and of the difference of two equal rotations.
ROTATION = 1e-6

#: Number of nearest handles that a handle is compared with, and how many of them must agree with it.
NEIGHBOURS, AGREEING = 8, 2
#: Growth of the distance between two handles from which on they disagree, as a multiple of the growth around
#: their neighbours. True poses of bodies and animals stay below 1.8.
STRETCH = 2.5

NO_HANDLES = "there are no handles; at least one vertex needs a prescribed position"


def checked_index(index: Any, *, once: bool = False) -> np.ndarray:
    """Return a copy of vertex ids (k,) as int64.

    Raises
    ------
    InputError
        If they are no ids, or there are none; with `once`, also if an id is given twice.
    """
    index = np.asarray(index)
    if index.ndim != 1 or (index.size and not np.issubdtype(index.dtype, np.integer)):
        given = f"not {index.dtype} of shape {index.shape}"
        raise InputError(f"handle ids must be integers (k,), or a mask with a value a vertex, {given}")
    if len(index) == 0:
        raise InputError(NO_HANDLES)
    if index.min() < 0:
        raise InputError(f"handle id {index.min()} is negative")
    if index.max() > np.iinfo(np.int64).max:
        raise InputError(f"handle id {index.max()} is no id of a vertex")
    if once and len(np.unique(index)) < len(index):
        raise InputError("a handle vertex is given twice")
    return index.astype(np.int64)


def ids_of(vertices: Any, n: int) -> Any:
    """Return vertex ids for a mask (n,) of the vertices; ids stay as they are."""
    mask = np.asarray(vertices)
    return np.flatnonzero(mask) if mask.dtype == bool and mask.shape == (n,) else vertices


def checked_target(target: Any, index: np.ndarray) -> np.ndarray:
    """Return targets (k, 3) of the vertices `index`; raise InputError if they are not finite."""
    target = np.asarray(target, dtype=np.float64)
    if target.shape != (len(index), 3):
        raise InputError(f"{_need(len(index))} targets of shape ({len(index)}, 3), not {target.shape}")
    finite = np.isfinite(target).all(axis=1)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise InputError(f"the target of handle {bad} (vertex {index[bad]}) is NaN or infinite")
    return target


def per_handle(values: Any, default: Any, dtype: Any, k: int, name: str) -> Any:
    """Return values (k,) of handles, k times the default if there are none, or None without a default."""
    if values is None:
        return None if default is None else np.full(k, default, dtype=dtype)
    given = np.asarray(values)
    if given.dtype.kind not in "biuf":
        raise InputError(f"`{name}` must be numbers, not {given.dtype}")
    with np.errstate(invalid="ignore"):
        values = given.astype(dtype)
    if dtype is not np.float64 and not np.array_equal(given, values):
        what = "True or False" if dtype is bool else "whole numbers"
        raise InputError(f"`{name}` must be {what}, not {given[given != values].flat[0]}")
    if values.shape != (k,):
        raise InputError(f"{_need(k)} `{name}` of shape ({k},), not {values.shape}")
    return values


def checked_weight(weight: Any, k: int) -> np.ndarray:
    """Return weights (k,), given as one number or one for each handle."""
    weight = np.inf if weight is None else weight
    weight = per_handle(weight if np.ndim(weight) else np.full(k, weight), None, np.float64, k, "weight")
    if not (weight > 0).all():
        bad = weight[~(weight > 0)][0]
        raise InputError(f"the weight of a handle goes from above 0 to inf (hard), not {bad}")
    return weight


def checked_rotation(rotation: Any, k: int) -> np.ndarray | None:
    """Return a copy of rotations (k, 3, 3), some of which may be NaN."""
    if rotation is None:
        return None
    R = np.array(rotation, dtype=np.float64)
    if R.shape != (k, 3, 3):
        raise InputError(f"{_need(k)} rotations of shape ({k}, 3, 3), not {R.shape}")
    require_rotations(R[~np.isnan(R).all(axis=(1, 2))])
    return R


def require_rotations(R: np.ndarray) -> None:
    """Raise InputError unless matrices (j, 3, 3) are orthonormal, to :data:`ROTATION`, and right-handed."""
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0)
    wrong = ~((off <= ROTATION) & (np.linalg.det(np.nan_to_num(R)) > 0))
    if wrong.any():
        bad = int(np.argmax(wrong))
        raise InputError(f"matrix {bad} is no rotation: its rows must be orthonormal and right-handed")


def first_of_each(fields: Mapping[str, Any], extent: float | None) -> np.ndarray:
    """Return where each id of handles first occurs, in input order; their other fields must agree."""
    index, target, group = (fields[name] for name in ("index", "target", "group"))
    weight, rotation = fields["weight"], fields["rotation"]
    _, first, inverse = np.unique(index, return_index=True, return_inverse=True)
    if len(first) < len(index):
        earlier = first[inverse]
        gap = np.linalg.norm(target - target[earlier], axis=1)
        extent = float(np.linalg.norm(np.ptp(target, axis=0))) if extent is None else extent
        if (gap > SAME_TARGET * extent).any():
            bad = int(np.argmax(gap))
            one, two = group[earlier[bad]], group[bad]
            where = f" in groups {one} and {two}" if one != two else ""
            raise InputError(
                f"vertex {index[bad]} has contradictory targets{where}, {gap[bad]:.3g} apart; "
                "give it one target"
            )
        differ = weight != weight[earlier]
        _refuse(index[differ], "has two weights; give each handle vertex one weight, or none")
        if rotation is not None:
            turn = rotation[earlier]
            gap = np.abs(rotation - turn).max(axis=(1, 2))
            differ = (gap > ROTATION) | (np.isnan(rotation) != np.isnan(turn)).any(axis=(1, 2))
            _refuse(index[differ], "has two rotations, or is given with a rotation and without; give it one")
    return np.sort(first)


def astray(rest: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Find handles that go far from where their neighbours go.

    Two handles agree if their distance grows by less than :data:`STRETCH`. Where parts of a surface move
    apart, handles have neighbours on their own side, which agree.

    Parameters
    ----------
    rest, target : (k, 3) float64
        Positions of handles at different places.

    Returns
    -------
    (a,) int64
        Handles with fewer than :data:`AGREEING` agreeing neighbours; none if there are too few handles.
    """
    from scipy.spatial import cKDTree

    if len(rest) <= NEIGHBOURS:
        return np.zeros(0, dtype=np.int64)
    distance, near = cKDTree(rest).query(rest, k=NEIGHBOURS + 1)
    apart = np.linalg.norm(target[:, None] - target[near[:, 1:]], axis=2)
    growth = np.sort(apart / np.maximum(distance[:, 1:], np.finfo(np.float64).tiny), axis=1)[:, AGREEING - 1]
    around = np.median(growth[near[:, 1:]], axis=1)
    return np.flatnonzero(growth > STRETCH * np.maximum(around, 1.0))


def _need(k: int) -> str:
    return counted(k, "handle needs", "handles need")


def _refuse(vertices: np.ndarray, found: str) -> None:
    """Raise InputError on the first of some vertices, if there are any."""
    if len(vertices):
        raise InputError(f"vertex {vertices[0]} {found}")
