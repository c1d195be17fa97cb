"""Which faces intersect: exact arithmetic as oracle, and collapsed faces."""

from fractions import Fraction

import numpy as np
import pytest

from eval.metrics.intersections import intersecting_faces

TWO = np.array([[0, 1, 2], [3, 4, 5]])
WALL = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]


def meet(V, F=TWO) -> bool:
    found = intersecting_faces(np.array(V, dtype=float), np.array(F))
    assert found.all() or not found.any()
    return bool(found.any())


def sub(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def cross(a, b):
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


def in_segment(x, a, b):
    return not any(cross(sub(b, a), sub(x, a))) and dot(sub(x, a), sub(x, b)) <= 0


def in_triangle(x, a, b, c):
    n = cross(sub(b, a), sub(c, a))
    sides = [(a, b), (b, c), (c, a)]
    if not any(n):
        return any(in_segment(x, p, q) for p, q in sides)
    return dot(n, sub(x, a)) == 0 and all(dot(cross(sub(q, p), sub(x, p)), n) >= 0 for p, q in sides)


def segments_meet(p, q, a, b):
    if in_segment(p, a, b) or in_segment(q, a, b) or in_segment(a, p, q) or in_segment(b, p, q):
        return True
    d, e = sub(q, p), sub(b, a)
    n = cross(d, e)
    if not any(n) or dot(n, sub(a, p)):
        return False
    s, t = (Fraction(dot(cross(sub(a, p), x), n), dot(n, n)) for x in (e, d))
    return 0 <= s <= 1 and 0 <= t <= 1


def segment_meets_triangle(p, q, a, b, c):
    if in_triangle(p, a, b, c) or in_triangle(q, a, b, c):
        return True
    if any(segments_meet(p, q, *side) for side in ((a, b), (b, c), (c, a))):
        return True
    n = cross(sub(b, a), sub(c, a))
    above, below = dot(n, sub(p, a)), dot(n, sub(q, a))
    if above * below >= 0:
        return False
    share = Fraction(above, above - below)
    return in_triangle([x + share * (y - x) for x, y in zip(p, q, strict=True)], a, b, c)


def triangles_meet(one, two):
    """By definition, in integers: a side of one meets the other."""
    return any(
        segment_meets_triangle(x[i - 1], x[i], *y) for x, y in ((one, two), (two, one)) for i in range(3)
    )


@pytest.mark.parametrize("size", [2, 3, 6])
def test_faces_without_a_common_corner_against_exact_arithmetic(size):
    """On a grid this small most pairs touch, lie in a plane, or have lost their area."""
    rng = np.random.default_rng(size)
    flat = 0
    for V in rng.integers(0, size, (700, 6, 3)):
        one, two = V[:3].tolist(), V[3:].tolist()
        points = any(face[0] == face[1] == face[2] for face in (one, two))
        assert meet(V) == (not points and triangles_meet(one, two)), V.tolist()
        flat += not np.cross(V[1] - V[0], V[2] - V[0]).any()
    assert flat > 5


def test_a_collapsed_face_through_a_wall_counts_although_it_has_no_plane():
    through = [[1, 1, -1], [1, 1, 1], [1, 1, 0.25]]
    assert meet(WALL + through)
    # Beside the wall, within its shadow on the plane z = 0, it does not.
    beside = [[0.5, 0.5, 3], [3.5, 3.5, -1], [2.75, 2.75, 0]]
    assert not meet(WALL + beside) and not meet(beside + WALL)
    # A needle on its way there, of a height of 1e-13.
    assert meet([*WALL, [1, 1, -1], [1, 1, 1], [1 + 1e-13, 1, 0.25]])
    assert not meet(WALL + 3 * [[1, 1, 0]])


def test_neighbours():
    corner = [[0, 1, 2], [0, 3, 4]]
    assert meet([*WALL, [2, 2, 1], [1, 1, -1]], corner)
    assert meet([*WALL, [4, 1, 0], [1, 4, 0]], corner)  # in one plane
    assert not meet([*WALL, [-1, 0, 1], [-1, 1, 0]], corner)
    edge = [[0, 1, 2], [1, 0, 3]]
    assert meet([*WALL, [1, 3, 0]], edge)  # folded flat
    assert not meet([*WALL, [1, 3, 1e-3]], edge)
    assert not meet([*WALL, [1, -3, 0]], edge)
    assert not meet([*WALL, [1, -3, 1]], [[0, 1, 2], [0, 1, 3]])  # wound against each other
