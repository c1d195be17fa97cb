"""Forward and backward substitution with ``L D L^T``, by one thread or by several, to the same bits.

L is unit lower triangular, in compressed columns without its diagonal, rows
ascending. Column j changes only rows that lie above j in the elimination tree,
so that branches of the tree know nothing of each other: several threads take
branches of about equal weight, and what remains, the top of the tree, is a
tenth of the entries on surface meshes. The top's rows are summed up in the
order in which the serial loop would change them.

T. A. Davis, "Direct methods for sparse linear systems", 2006, chapters 3 and 4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import csc_array

from sshade.parallel import Crew


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
    node : list of (b,) int32
        For each thread the nodes of its branches, ascending.
    inside : (n,) int64
        End of the entries of each column that lie in its own branch.
    top : (t,) int32
        The nodes of no branch, ascending.
    share : (parts + 1,) int64
        Where each thread's part of the top's rows begins.
    first, middle, end : (t,) int64
        Where each of the top's rows of L begins, has its first entry in a column of the top, and ends.
    column : (y,) int32
    value : (y,) float64
    """

    node: list[np.ndarray]
    inside: np.ndarray
    top: np.ndarray
    share: np.ndarray
    first: np.ndarray
    middle: np.ndarray
    end: np.ndarray
    column: np.ndarray
    value: np.ndarray


def substitute(factors: Factors, X: np.ndarray) -> None:
    """Solve ``L D L^T X = X`` in place, for X (n, c) float64, C-contiguous."""
    kernel = {3: _three, 6: _six}.get(X.shape[1], _any)
    kernel(*factors, X)


def substitute_together(factors: Factors, branches: Branches, X: np.ndarray, *, crew: Crew) -> None:
    """:func:`substitute` with as many threads as there are parts in `branches`; the same bits."""
    start, row, value, inverse_pivot = factors
    node, inside, top, share, first, middle, end, *rows = branches
    parts, zeros = len(node), (0.0,) * X.shape[1]

    def forward(p: int) -> None:
        _columns(node[p], start, inside, row, value, X, zeros)

    def forward_top(p: int) -> None:
        own = slice(share[p], share[p + 1])
        _rows(top[own], first[own], middle[own], *rows, X, zeros)

    def backward(p: int) -> None:
        _transposed(node[p], start, row, value, inverse_pivot, X, zeros)

    crew(forward, parts)
    crew(forward_top, parts)
    _rows(top, middle, end, *rows, X, zeros)
    _transposed(top, start, row, value, inverse_pivot, X, zeros)
    crew(backward, parts)


def divide(factors: Factors, parts: int) -> Branches:
    """Divide the elimination tree into branches for `parts` threads, and the top.

    Branches are as large as they can be with at most 0.8 / parts of all
    entries; the heaviest first, each goes to the thread with the least work.
    """
    start, row, value, _ = factors
    n = len(start) - 1
    weight, branch = np.zeros(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    _branches(start, row, int(0.8 / parts * len(row)), weight, branch)
    roots = np.flatnonzero(branch == np.arange(n))
    load, part = np.zeros(parts), np.full(n + 1, -1)
    for root in roots[np.argsort(-weight[roots], kind="stable")]:
        part[root] = load.argmin()
        load[part[root]] += weight[root]
    part = part[branch]  # the top's branch is -1, and so is its part
    in_top = part < 0
    top = np.flatnonzero(in_top).astype(np.int32)
    below = np.concatenate([[0], np.cumsum(~in_top[row])])
    rows = csc_array((value, row, start), shape=(n, n)).tocsr()[top]
    rows.sort_indices()
    first, end = rows.indptr[:-1].astype(np.int64), rows.indptr[1:].astype(np.int64)
    before = np.concatenate([[0], np.cumsum(in_top[rows.indices])])
    middle = np.minimum(np.searchsorted(before, before[first], side="right") - 1, end)
    done = np.concatenate([[0], np.cumsum(middle - first)])
    return Branches(
        node=[np.flatnonzero(part == p).astype(np.int32) for p in range(parts)],
        inside=start[:-1] + below[start[1:]] - below[start[:-1]],
        top=top,
        share=np.searchsorted(done, np.linspace(0, done[-1], parts + 1)),
        first=first,
        middle=middle,
        end=end,
        column=rows.indices.astype(np.int32),
        value=rows.data,
    )


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
def _columns(node, start, end, row, value, X, zeros):
    """Forward substitution with the columns `node`, up to `end`; a tuple's length is known when compiling."""
    x = np.empty(len(zeros))
    for j in node:
        for c in range(len(zeros)):
            x[c] = X[j, c]
        for k in range(start[j], end[j]):
            i, v = row[k], value[k]
            for c in range(len(zeros)):
                X[i, c] -= v * x[c]


@njit(cache=True, nogil=True)
def _rows(node, first, end, column, value, X, zeros):
    """Forward substitution into the rows `node`, with their entries from `first` to `end`."""
    x = np.empty(len(zeros))
    for r in range(len(node)):
        i = node[r]
        for c in range(len(zeros)):
            x[c] = X[i, c]
        for k in range(first[r], end[r]):
            j, v = column[k], value[k]
            for c in range(len(zeros)):
                x[c] -= v * X[j, c]
        for c in range(len(zeros)):
            X[i, c] = x[c]


@njit(cache=True, nogil=True)
def _transposed(node, start, row, value, inverse_pivot, X, zeros):
    """Division by D and backward substitution of the rows `node`, the last first."""
    x = np.empty(len(zeros))
    for j in node[::-1]:
        for c in range(len(zeros)):
            x[c] = inverse_pivot[j] * X[j, c]
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            for c in range(len(zeros)):
                x[c] -= v * X[i, c]
        for c in range(len(zeros)):
            X[j, c] = x[c]


@njit(cache=True, nogil=True)
def _three(start, row, value, inverse_pivot, X):
    """Solve L D L^T X = X for three columns; L is unit lower triangular, by columns, without diagonal."""
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
        for k in range(start[j], start[j + 1]):
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
        for k in range(start[j], start[j + 1]):
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
        for k in range(start[j], start[j + 1]):
            i, v = row[k], value[k]
            a -= v * X[i, 0]
            b -= v * X[i, 1]
            c -= v * X[i, 2]
            d -= v * X[i, 3]
            e -= v * X[i, 4]
            f -= v * X[i, 5]
        X[j, 0], X[j, 1], X[j, 2], X[j, 3], X[j, 4], X[j, 5] = a, b, c, d, e, f
