"""The graph of a matrix: a gauge that makes it real, an order that makes it narrow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._systems.waves.entries import Entries
from liouville._systems.waves.frame import FLUX

#: Below this order a state fits in a fast cache, and the order of its components does not matter.
LARGE = 2**15

#: An order is taken if it makes the reach smaller by this factor.
GAIN = 4


def gauge(matrices: Sequence[Entries]) -> np.ndarray | None:
    r"""Find phases g that make all :math:`\bar g_i H_{ij} g_j` real, in O(entries).

    Along a spanning tree they are products of the phases of entries; they fit all other entries if
    and only if the flux through every loop is 0 or :math:`\pi`.

    Parameters
    ----------
    matrices : sequence of Entries
        Complex Hermitian matrices of the same order.

    Returns
    -------
    ndarray or None
        The phases, shape (N,), or None if there are none.
    """
    n = matrices[0].n
    row, col, values = (
        np.concatenate([getattr(m, name) for m in matrices]) for name in ("row", "col", "values")
    )
    off = (row != col) & (values != 0)  # a zero has no phase
    row, col, values = row[off], col[off], values[off]
    places, first = np.unique(row * n + col, return_index=True)
    phases = values[first] / np.abs(values[first])
    g = _along_a_tree(n, row[first], col[first], places, phases)
    left = (g.conj()[row] * values * g[col]).imag
    fits = np.abs(left) <= FLUX * np.abs(values).max(initial=0.0)
    return g if fits.all() else None


def _along_a_tree(
    n: int, row: np.ndarray, col: np.ndarray, places: np.ndarray, phases: np.ndarray
) -> np.ndarray:
    """Multiply phases from the root of each component on: g_j = g_i conj(phase of H_ij)."""
    sparse = _scipy()
    # a root beside all of them makes one tree of the components
    count, component = sparse.csgraph.connected_components(_graph(n, row, col), directed=False)
    roots = np.full(count, n)
    np.minimum.at(roots, component, np.arange(n))
    tails, heads = np.full(count, n), roots
    graph = _graph(n + 1, np.concatenate([row, tails]), np.concatenate([col, heads]))
    _, parent = sparse.csgraph.breadth_first_order(graph, n, directed=True)
    above = parent[:n].astype(np.int64)
    is_root = above == n
    step = np.ones(n, dtype=complex)
    at = np.flatnonzero(~is_root)
    step[at] = phases[np.searchsorted(places, above[at] * n + at)].conj()
    above[is_root] = np.flatnonzero(is_root)
    while not np.array_equal(above, above[above]):  # pointer jumping: depth halves each time
        step = step * step[above]
        above = above[above]
        step /= np.abs(step)
    g: np.ndarray = step
    return g


def narrow(matrices: Sequence[Entries]) -> np.ndarray | None:
    """Find an order in which entries are near the diagonal, of Cuthill and McKee's, reversed.

    Parameters
    ----------
    matrices : sequence of Entries
        Matrices of the same order.

    Returns
    -------
    ndarray or None
        The component in each place, or None where that would not help.
    """
    n, reach = matrices[0].n, max(matrix.reach for matrix in matrices)
    if n < LARGE or reach * 32 <= n:
        return None
    row = np.concatenate([matrix.row for matrix in matrices])
    col = np.concatenate([matrix.col for matrix in matrices])
    order = _scipy().csgraph.reverse_cuthill_mckee(_graph(n, row, col), symmetric_mode=True)
    order = order.astype(np.int64)
    place = np.empty(n, dtype=np.int64)
    place[order] = np.arange(n)
    found = int(np.abs(place[row] - place[col]).max(initial=0))
    return order if found * GAIN <= reach else None


def _graph(n: int, row: np.ndarray, col: np.ndarray) -> Any:
    return _scipy().csr_array((np.ones(row.size, dtype=np.int8), (row, col)), shape=(n, n))


def _scipy() -> Any:
    try:
        import scipy.sparse.csgraph
    except ImportError:
        sentence = "the phases of a complex matrix are found by SciPy, which is not installed"
        raise ImportError(hinted(sentence, "pip install scipy")) from None
    return scipy.sparse
