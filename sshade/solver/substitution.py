"""Forward and backward substitution with ``L D L^T``, by one thread or by several, to the same bits.

L is unit lower triangular, in compressed columns without its diagonal, rows
ascending. Column j changes only rows that lie above j in the elimination tree, so
that subtrees know nothing of each other. Several threads take subtrees of about
equal weight; the separator, the top of the tree with a seventh of the entries on
surface meshes, comes last. With the rows in that order

        | L_1                     |
        |      L_2                |        L_p  subtrees of chunk p
    L = |           ...           |        B_p  rows of the separator, columns of chunk p
        |                L_k      |        S    the separator
        | B_1  B_2  ...  B_k   S  |

forward substitution is ``L_p x_p = b_p`` for all p at once, then the rows of ``b_s -
sum_p B_p x_p`` at once, then S; backward substitution is S^T, then all ``L_p^T`` and
``B_p^T`` at once. What is subtracted from a row of the separator is so in the order
of the serial loop.

T. A. Davis, "Direct methods for sparse linear systems", 2006, chapters 3 and 4.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.sparse import csc_array

from sshade.threads import ThreadTeam

#: Chunks of about equal weight into which a tree is divided, whatever the number of threads.
CHUNKS = 4


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


class Subtrees(NamedTuple):
    """The elimination tree in chunks and a separator; see :func:`divide`.

    Attributes
    ----------
    bounds : (k + 2,) int64
        Where the rows of each chunk begin, those of the separator, and their end.
    inside : (n,) int64
        End of the entries of each column that lie in its L_p; all entries of the separator's.
    share : (k + 1,) int64
        Where each thread's part of the separator's rows begins, of about equal weight.
    first : (t + 1,) int64
        Where each of the t rows of ``[B_1 ... B_k]`` begins.
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
    start, row, value, _ = factors
    n = len(X)

    def solve(Y: np.ndarray) -> None:
        _forward(0, n, start, start[1:], row, value, Y)
        _backward(0, n, *factors, Y)

    _by_threes(solve, X)


def substitute_together(factors: Factors, subtrees: Subtrees, X: np.ndarray, *, team: ThreadTeam) -> None:
    """:func:`substitute` by the threads of a team; the same bits."""
    start, row, value, _ = factors
    bounds, inside, share, *rows = subtrees
    chunks = len(share) - 1

    def solve(Y: np.ndarray) -> None:
        def forward(p: int) -> None:
            _forward(bounds[p], bounds[p + 1], start, inside, row, value, Y)

        def to_separator(p: int) -> None:
            _rows(share[p], share[p + 1], bounds[chunks], *rows, Y)

        def backward(p: int) -> None:
            _backward(bounds[p], bounds[p + 1], *factors, Y)

        team(forward, chunks)
        team(to_separator, chunks)
        forward(chunks)
        backward(chunks)
        team(backward, chunks)

    _by_threes(solve, X)


def _by_threes(solve: Callable[[np.ndarray], None], X: np.ndarray) -> None:
    """Solve for the columns of X (n, c) three at a time, the points or vectors that they mostly are."""
    if X.shape[1] == 3:
        solve(X)
        return
    for c in range(0, X.shape[1], 3):
        part = X[:, c : c + 3]
        Y = np.zeros((len(X), 3))
        Y[:, : part.shape[1]] = part
        solve(Y)
        part[:] = Y[:, : part.shape[1]]


def divide(factors: Factors, *, chunks: int = CHUNKS) -> tuple[np.ndarray, Factors, Subtrees]:
    """Divide the elimination tree into chunks of subtrees, of about equal weight, and a separator.

    Subtrees are as large as they can be with at most 0.8 / chunks of all entries;
    the heaviest first, each goes to the chunk with the least weight.

    Parameters
    ----------
    factors : Factors
    chunks : int

    Returns
    -------
    order : (n,) int64
        Present place of each row in the new order: chunk after chunk, then the separator.
    factors : Factors
        The same in that order.
    subtrees : Subtrees
        Of that order.
    """
    n, entries = len(factors.inverse_pivot), len(factors.row)
    weight, subtree = np.zeros(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    _subtrees(factors.start, factors.row, int(0.8 / chunks * entries), weight, subtree)
    roots = np.flatnonzero(subtree == np.arange(n))
    load, chunk = np.zeros(chunks), np.full(n + 1, chunks)
    for root in roots[np.argsort(-weight[roots], kind="stable")]:
        chunk[root] = load.argmin()
        load[chunk[root]] += weight[root]
    chunk = chunk[subtree]  # the separator's subtree is -1, and so is the last entry's
    order = np.argsort(chunk, kind="stable")
    bounds = np.concatenate([[0], np.cumsum(np.bincount(chunk, minlength=chunks + 1))])
    start, row, value = np.empty(n + 1, dtype=np.int64), np.empty_like(factors.row), np.empty(entries)
    inside = np.empty(n, dtype=np.int64)
    _reordered(*factors[:3], order, bounds[chunks], start, row, value, inside)
    separator = bounds[chunks]
    inside[separator:] = start[separator + 1 :]
    B = csc_array((value, row, start), shape=(n, n))[separator:, :separator].tocsr()
    first = B.indptr.astype(np.int64)
    subtrees = Subtrees(
        bounds=bounds,
        inside=inside,
        share=np.searchsorted(first, np.linspace(0, first[-1], chunks + 1)),
        first=first,
        column=B.indices.astype(np.int32),
        value=B.data,
    )
    return order, Factors(start, row, value, factors.inverse_pivot[order]), subtrees


@njit(cache=True, nogil=True)
def _subtrees(start, row, limit, weight, subtree):
    """Entries of L at and below each node, and the root of its subtree; -1 in the separator."""
    n = len(subtree)
    for j in range(n):
        weight[j] += start[j + 1] - start[j]
        if start[j] < start[j + 1]:
            weight[row[start[j]]] += weight[j]  # the first row below the diagonal is the parent
    for j in range(n - 1, -1, -1):
        parent = row[start[j]] if start[j] < start[j + 1] else -1
        if parent >= 0 and subtree[parent] >= 0:
            subtree[j] = subtree[parent]
        else:
            subtree[j] = j if weight[j] <= limit else -1


@njit(cache=True, nogil=True)
def _reordered(start, row, value, order, separator, new_start, new_row, new_value, inside):
    """Columns in another order; rows stay ascending, as as within a subtree."""
    place = np.empty(len(order), dtype=row.dtype)
    for j in range(len(order)):
        place[order[j]] = j
    new_start[0] = end = 0
    for j in range(len(order)):
        inside[j] = end
        for k in range(start[order[j]], start[order[j] + 1]):
            new_row[end], new_value[end] = place[row[k]], value[k]
            inside[j] += new_row[end] < separator
            end += 1
        new_start[j + 1] = end


@njit(cache=True, nogil=True)
def _forward(begin, end, start, inside, row, value, X):
    """Forward substitution with the columns of L from `begin` to `end`, as far as `inside`."""
    for j in range(begin, end):
        a, b, c = X[j, 0], X[j, 1], X[j, 2]
        for k in range(start[j], inside[j]):
            i, v = row[k], value[k]
            X[i, 0] -= v * a
            X[i, 1] -= v * b
            X[i, 2] -= v * c


@njit(cache=True, nogil=True)
def _rows(begin, end, separator, first, column, value, X):
    """Subtract ``sum_p B_p x_p`` from the separator's rows from `begin` to `end`."""
    for r in range(begin, end):
        i = separator + r
        a, b, c = X[i, 0], X[i, 1], X[i, 2]
        for k in range(first[r], first[r + 1]):
            j, v = column[k], value[k]
            a -= v * X[j, 0]
            b -= v * X[j, 1]
            c -= v * X[j, 2]
        X[i, 0], X[i, 1], X[i, 2] = a, b, c


@njit(cache=True, nogil=True)
def _backward(begin, end, start, row, value, inverse_pivot, X):
    """Division by D and backward substitution of the rows from `begin` to `end`, the last first.

    Of its terms a row takes those last that are known last: the processor does not wait for them.
    """
    for j in range(end - 1, begin - 1, -1):
        d = inverse_pivot[j]
        a, b, c = d * X[j, 0], d * X[j, 1], d * X[j, 2]
        for k in range(start[j + 1] - 1, start[j] - 1, -1):
            i, v = row[k], value[k]
            a -= v * X[i, 0]
            b -= v * X[i, 1]
            c -= v * X[i, 2]
        X[j, 0], X[j, 1], X[j, 2] = a, b, c
