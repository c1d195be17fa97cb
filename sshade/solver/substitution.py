"""Forward and backward substitution with ``L D L^T``, by one thread or by several, to the same bits.

L is unit lower triangular, in compressed columns without its diagonal, rows
ascending. Column j changes only rows that lie above j in the elimination tree,
so that branches of the tree know nothing of each other: several threads take
branches of about equal weight, and what remains, the top of the tree, is a
seventh of the entries on surface meshes. Rows are in an order in which the
branches of a part follow each other and the top comes last. What the parts add to
the top's rows is summed up in the order in which the serial loop would do it.

T. A. Davis, "Direct methods for sparse linear systems", 2006, chapters 3 and 4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import csc_array

from sshade.threads import ThreadTeam

#: Parts of about equal weight into which a tree is divided, whatever the number of threads.
PARTS = 4


class Factors(NamedTuple):
    """L and D.

    Attributes
    ----------
    start : (n + 1,) int64
        Where each column of L begins.
    row : (z,) int32
    value : (z,) float64
    inverse_pivot : (n,) float64
        ``1 / D``.
    """

    start: np.ndarray
    row: np.ndarray
    value: np.ndarray
    inverse_pivot: np.ndarray


class Branches(NamedTuple):
    """A division of the elimination tree; see :func:`divide`.

    Attributes
    ----------
    bounds : (parts + 2,) int64
        Where the rows of each part begin, those of the top, and their end.
    inside : (n,) int64
        End of the entries of each column of a part that lie in that part; all entries of the top's.
    share : (parts + 1,) int64
        Where each thread's part of the top's rows begins, of about equal weight.
    first : (t + 1,) int64
        Where each of the top's t rows of L begins, without what lies in columns of the top.
    column : (y,) int32
    value : (y,) float64
    """

    bounds: np.ndarray
    inside: np.ndarray
    share: np.ndarray
    first: np.ndarray
    column: np.ndarray
    value: np.ndarray


def substitute(factors: Factors, X: np.ndarray) -> None:
    """Solve ``L D L^T X = X`` in place, for X (n, c) float64, C-contiguous."""
    kernel = {3: _three, 6: _six}.get(X.shape[1], _any)
    kernel(*factors, X)


def substitute_together(factors: Factors, branches: Branches, X: np.ndarray, *, team: ThreadTeam) -> None:
    """:func:`substitute` by the threads of a team; the same bits.

    X (n, c) has three columns or a multiple of that: points and vectors.
    """
    start, row, value, inverse_pivot = factors
    bounds, inside, share, *rows = branches
    parts = len(share) - 1

    def forward(p: int) -> None:
        _columns(bounds[p], bounds[p + 1], start, inside, row, value, X)

    def forward_top(p: int) -> None:
        _rows(share[p], share[p + 1], bounds[parts], *rows, X)

    def backward(p: int) -> None:
        _transposed(bounds[p], bounds[p + 1], start, row, value, inverse_pivot, X)

    team(forward, parts)
    team(forward_top, parts)
    forward(parts)
    backward(parts)
    team(backward, parts)


def divide(factors: Factors, *, parts: int = PARTS) -> tuple[np.ndarray, Factors, Branches]:
    """Divide the elimination tree into branches, in some parts of about equal weight, and the top.

    Branches are as large as they can be with at most 0.8 / parts of all
    entries; the heaviest first, each goes to the part with the least weight.

    Parameters
    ----------
    factors : Factors
    parts : int

    Returns
    -------
    order : (n,) int64
        Present place of each row in the new order: part after part, then the top.
    factors : Factors
        The same in that order.
    branches : Branches
        Of that order.
    """
    n, entries = len(factors.inverse_pivot), len(factors.row)
    weight, branch = np.zeros(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    _branches(factors.start, factors.row, int(0.8 / parts * entries), weight, branch)
    roots = np.flatnonzero(branch == np.arange(n))
    load, part = np.zeros(parts), np.full(n + 1, parts)
    for root in roots[np.argsort(-weight[roots], kind="stable")]:
        part[root] = load.argmin()
        load[part[root]] += weight[root]
    part = part[branch]  # the top's branch is -1, and so is the last entry's
    order = np.argsort(part, kind="stable")
    bounds = np.concatenate([[0], np.cumsum(np.bincount(part, minlength=parts + 1))])
    start, row, value = np.empty(n + 1, dtype=np.int64), np.empty_like(factors.row), np.empty(entries)
    inside = np.empty(n, dtype=np.int64)
    _reordered(*factors[:3], order, bounds[parts], start, row, value, inside)
    top, rest = bounds[parts], start[bounds[parts]]
    inside[top:] = start[top + 1 :]
    below = row[:rest] >= top
    columns = np.repeat(np.arange(top, dtype=np.int32), np.diff(start[: top + 1]))[below]
    rows = csc_array((value[:rest][below], (row[:rest][below] - top, columns)), shape=(n - top, top)).tocsr()
    rows.sort_indices()
    first = rows.indptr.astype(np.int64)
    branches = Branches(
        bounds=bounds,
        inside=inside,
        share=np.searchsorted(first, np.linspace(0, first[-1], parts + 1)),
        first=first,
        column=rows.indices.astype(np.int32),
        value=rows.data,
    )
    return order, Factors(start, row, value, factors.inverse_pivot[order]), branches


@njit(cache=True, nogil=True)
def _branches(start, row, limit, weight, branch):
    """Entries of L at and below each node, and the root of its branch; -1 in the top."""
    n = len(branch)
    for j in range(n):
        weight[j] += start[j + 1] - start[j]
        if start[j] < start[j + 1]:
            weight[row[start[j]]] += weight[j]  # the first row below the diagonal is the parent
    for j in range(n - 1, -1, -1):
        parent = row[start[j]] if start[j] < start[j + 1] else -1
        if parent >= 0 and branch[parent] >= 0:
            branch[j] = branch[parent]
        else:
            branch[j] = j if weight[j] <= limit else -1


@njit(cache=True, nogil=True)
def _reordered(start, row, value, order, top, new_start, new_row, new_value, inside):
    """Columns in another order; rows stay ascending, as those of a branch and of the top keep theirs."""
    place = np.empty(len(order), dtype=row.dtype)
    for j in range(len(order)):
        place[order[j]] = j
    new_start[0] = end = 0
    for j in range(len(order)):
        inside[j] = end
        for k in range(start[order[j]], start[order[j] + 1]):
            new_row[end], new_value[end] = place[row[k]], value[k]
            inside[j] += new_row[end] < top
            end += 1
        new_start[j + 1] = end


@njit(cache=True, nogil=True)
def _columns(begin, end, start, inside, row, value, X):
    """Forward substitution with the columns of L from `begin` to `end`, as far as `inside`."""
    for j in range(begin, end):
        for o in range(0, X.shape[1], 3):
            a, b, c = X[j, o], X[j, o + 1], X[j, o + 2]
            for k in range(start[j], inside[j]):
                i, v = row[k], value[k]
                X[i, o] -= v * a
                X[i, o + 1] -= v * b
                X[i, o + 2] -= v * c


@njit(cache=True, nogil=True)
def _rows(begin, end, top, first, column, value, X):
    """Forward substitution into the top's rows from `begin` to `end`, with what parts add."""
    for r in range(begin, end):
        i = top + r
        for o in range(0, X.shape[1], 3):
            a, b, c = X[i, o], X[i, o + 1], X[i, o + 2]
            for k in range(first[r], first[r + 1]):
                j, v = column[k], value[k]
                a -= v * X[j, o]
                b -= v * X[j, o + 1]
                c -= v * X[j, o + 2]
            X[i, o], X[i, o + 1], X[i, o + 2] = a, b, c


@njit(cache=True, nogil=True)
def _transposed(begin, end, start, row, value, inverse_pivot, X):
    """Division by D and backward substitution of the rows from `begin` to `end`, the last first.

    Of its terms a row takes those last that are known last: the processor does not wait for them.
    """
    for j in range(end - 1, begin - 1, -1):
        d = inverse_pivot[j]
        for o in range(0, X.shape[1], 3):
            a, b, c = d * X[j, o], d * X[j, o + 1], d * X[j, o + 2]
            for k in range(start[j + 1] - 1, start[j] - 1, -1):
                i, v = row[k], value[k]
                a -= v * X[i, o]
                b -= v * X[i, o + 1]
                c -= v * X[i, o + 2]
            X[j, o], X[j, o + 1], X[j, o + 2] = a, b, c


@njit(cache=True, nogil=True)
def _three(start, row, value, inverse_pivot, X):
    """Solve L D L^T X = X for three columns; L is unit lower triangular, by columns, without diagonal.

    Backward with the terms of :func:`_transposed` in its order.
    """
    n = len(inverse_pivot)
    for j in range(n):
        a, b, c = X[j, 0], X[j, 1], X[j, 2]
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            X[i, 0] -= v * a
            X[i, 1] -= v * b
            X[i, 2] -= v * c
    for j in range(n - 1, -1, -1):
        d = inverse_pivot[j]
        a, b, c = d * X[j, 0], d * X[j, 1], d * X[j, 2]
        for k in range(start[j + 1] - 1, start[j] - 1, -1):
            i, v = row[k], value[k]
            a -= v * X[i, 0]
            b -= v * X[i, 1]
            c -= v * X[i, 2]
        X[j, 0], X[j, 1], X[j, 2] = a, b, c


@njit(cache=True, nogil=True)
def _any(start, row, value, inverse_pivot, X):
    """:func:`_three` for any number of columns."""
    n, columns = X.shape
    for j in range(n):
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            for c in range(columns):
                X[i, c] -= v * X[j, c]
    for j in range(n - 1, -1, -1):
        for c in range(columns):
            X[j, c] *= inverse_pivot[j]
        for k in range(start[j + 1] - 1, start[j] - 1, -1):
            i, v = row[k], value[k]
            for c in range(columns):
                X[j, c] -= v * X[i, c]


@njit(cache=True, nogil=True)
def _six(start, row, value, inverse_pivot, X):
    """:func:`_three` for six columns."""
    n = len(inverse_pivot)
    for j in range(n):
        a, b, c, d, e, f = X[j, 0], X[j, 1], X[j, 2], X[j, 3], X[j, 4], X[j, 5]
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            X[i, 0] -= v * a
            X[i, 1] -= v * b
            X[i, 2] -= v * c
            X[i, 3] -= v * d
            X[i, 4] -= v * e
            X[i, 5] -= v * f
    for j in range(n - 1, -1, -1):
        p = inverse_pivot[j]
        a, b, c, d, e, f = p * X[j, 0], p * X[j, 1], p * X[j, 2], p * X[j, 3], p * X[j, 4], p * X[j, 5]
        for k in range(start[j + 1] - 1, start[j] - 1, -1):
            i, v = row[k], value[k]
            a -= v * X[i, 0]
            b -= v * X[i, 1]
            c -= v * X[i, 2]
            d -= v * X[i, 3]
            e -= v * X[i, 4]
            f -= v * X[i, 5]
        X[j, 0], X[j, 1], X[j, 2], X[j, 3], X[j, 4], X[j, 5] = a, b, c, d, e, f
