"""Dual quaternion skinning."""

from __future__ import annotations

import numpy as np


def bone_motions(joints: np.ndarray, parents: np.ndarray, *, rotations: np.ndarray) -> np.ndarray:
    """Rigid motion of each bone as a unit dual quaternion.

    A bone turns about its joint, then follows its parent. Rotations are about world axes, so zero
    rotations give the rest pose.

    Parameters
    ----------
    joints : (b, 3) float64
        Rest position of each bone's joint, in metres.
    parents : (b,) int
        Parent of each bone, -1 at the root. Parents come before their children.
    rotations : (b, 3) float64
        Rotation vectors, in radians.

    Returns
    -------
    (b, 8) float64
        Real part (w, x, y, z), then dual part. The real part of a child is its parent's real part times a
        rotation of less than half a turn. Neighbouring bones therefore lie in one hemisphere, and
        blending them is safe.
    """
    local = _from_rotation_vectors(rotations)
    real = np.empty((len(joints), 4))
    origin = np.empty((len(joints), 3))
    for bone, parent in enumerate(parents):
        if parent < 0:
            real[bone], origin[bone] = local[bone], joints[bone]
        else:
            real[bone] = _multiply(real[parent], local[bone])
            origin[bone] = origin[parent] + _rotate(real[parent], joints[bone] - joints[parent])
    translation = origin - _rotate(real, joints)
    dual = 0.5 * _multiply(np.concatenate([np.zeros((len(joints), 1)), translation], axis=1), real)
    return np.concatenate([real, dual], axis=1)


def apply_motions(motions: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Move each point by its dual quaternion, which need not have unit length.

    Parameters
    ----------
    motions : (n, 8) float64
    points : (n, 3) float64

    Returns
    -------
    (n, 3) float64
    """
    motions = motions / np.linalg.norm(motions[:, :4], axis=1, keepdims=True)
    real, dual = motions[:, :4], motions[:, 4:]
    conjugate = real * np.array([1.0, -1.0, -1.0, -1.0])
    return _rotate(real, points) + 2.0 * _multiply(dual, conjugate)[:, 1:]


def blend_motions(motions: np.ndarray, *, bone: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Blend the bones' motions at each vertex, for :func:`apply_motions`.

    Parameters
    ----------
    motions : (b, 8) float64
        From :func:`bone_motions`.
    bone : (n, k) int
        Bones of each vertex.
    weight : (n, k) float64
        Their weights; each row sums to 1.

    Returns
    -------
    (n, 8) float64

    References
    ----------
    L. Kavan, S. Collins, J. Zara, C. O'Sullivan, "Skinning with dual quaternions", 2007.
    """
    return np.einsum("nk,nkc->nc", weight, motions[bone])


def _from_rotation_vectors(vectors: np.ndarray) -> np.ndarray:
    """(b, 4) unit quaternions (w, x, y, z)."""
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    # sinc computes sin(h) / h exactly at zero.
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors], axis=1)


def _multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Multiply quaternions along the last axis."""
    aw, av, bw, bv = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    w = aw * bw - (av * bv).sum(axis=-1, keepdims=True)
    return np.concatenate([w, aw * bv + bw * av + np.cross(av, bv)], axis=-1)


def _rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rotate vectors by unit quaternions, along the last axis."""
    u = q[..., 1:]
    return v + 2.0 * np.cross(u, np.cross(u, v) + q[..., :1] * v)
