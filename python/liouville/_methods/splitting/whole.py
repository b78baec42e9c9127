"""A whole field of degree d by n + d shears."""

from __future__ import annotations

import numpy as np

from liouville._basics.errors import hinted, misshapen
from liouville._methods.splitting.basis import check_size, transformed
from liouville._methods.splitting.directions import harmonic, spread
from liouville._methods.splitting.elimination import SingularError, inverse
from liouville._methods.splitting.natural import natural
from liouville._methods.splitting.pieces import Split, same_kind
from liouville._methods.splitting.shears import shears
from liouville._systems.fields.terms import Terms


def whole(terms: Terms, directions: np.ndarray | None = None, merged: bool = True) -> Split:
    """Split a field of degree d into shears along n + d directions a_1, ..., a_(n+d).

    If every n of them are independent, each homogeneous field of degree d without divergence is
    uniquely a sum of such shears. Here d of them, evenly spread, are the columns of A_2 and the
    rest those of A_1: in y = A_1^-1 x the former are the directions of the diagonal part, and the
    latter those of natural shears.

    Parameters
    ----------
    terms : Terms
        A field without waves.
    directions : ndarray, shape (n, n + d), optional
        The directions, as columns; by default the harmonic frame.
    merged : bool
        Whether natural shears may be united.

    Raises
    ------
    ValueError
        The directions are not in general position.
    """
    n, d = terms.n, max(terms.degree, 1)
    check_size(n, d)
    if directions is None:
        frame = harmonic(n, d, terms.is_exact)
    else:
        frame = np.asarray(directions)
        if frame.shape != (n, n + d):
            raise misshapen("directions", frame.shape, f"({n}, {n + d})")
        frame = same_kind(frame, terms)
    apart = spread(n, d)
    basis = np.delete(frame, apart, axis=1)
    try:
        inward = inverse(basis)
    except SingularError as error:
        hint = "every n of them must be independent"
        raise ValueError(hinted("the directions are not in general position", hint)) from error
    pieces, rest = shears(transformed(terms, inward, basis), inward @ frame[:, apart])
    return Split(n, (*pieces, *natural(rest, merged)), basis, inward)
