"""Rotation numbers of sections: how far points go round a centre from crossing to crossing."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.errors import hinted, misshapen

if TYPE_CHECKING:
    from liouville._studies.section import Section

#: The fewest crossings that a number is made of.
FEWEST = 4


def rotation_numbers(
    section: Section, *, about: ArrayLike, of: Sequence[str] | None = None
) -> NDArray[np.float64]:
    r"""Compute the rotation number of each trajectory of a section.

    .. math::

        \omega = \frac{1}{2\pi} \sum_k w_k\, \Delta\theta_k \Big/ \sum_k w_k, \qquad
        w_k = \exp\left(-\frac{1}{s_k (1 - s_k)}\right), \quad s_k = \frac{k + 1/2}{K}

    with the changes of the angle about a centre between crossings, each within half a turn. With
    these weights the mean of a quasiperiodic motion converges faster than any power of the number K
    of changes, and the numbers of chaotic ones do not settle. On a torus with a crossing each time
    round it is the rotational transform, but for whole numbers.

    Parameters
    ----------
    section : Section
        The crossings, of one plane or of parallel ones, in one direction.
    about : array_like, shape (2,) or (P, 2)
        The centre, for all of P trajectories or for each, in the coordinates of states: of a
        cylinder q = R^2/2, not R.
    of : sequence of two str, optional
        The coordinates that the angle is in: from the first one to the second one it is positive.
        By default the two that there are, but for one whose planes are crossed.

    Returns
    -------
    ndarray, shape (P,)
        Turns from crossing to crossing, from -1/2 to 1/2, in the order of the crossings; NaN where
        there are fewer than four of them.

    Raises
    ------
    TypeError, ValueError
        It is no section, there are no two such coordinates, or the centre has another shape or is
        not finite.

    Warns
    -----
    UserWarning
        No trajectory goes round its centre: all crossings are within half a turn about it.

    References
    ----------
    :cite:t:`das2017`.

    Examples
    --------
    >>> import numpy as np
    >>> import liouville as lv
    >>> turning = lv.PolynomialField(lambda t, x, params: [-x[1], x[0], 1], x=("x", "y", "z"))
    >>> found = lv.section(turning, lv.VolumeSplitting(composition="BM6"), t=(0, 50), h=0.05,
    ...                    plane="z", period=1.0, x=[[1.0, 0.0, 0.5]])
    >>> bool(abs(lv.analysis.rotation_numbers(found, about=(0, 0))[0] - 1 / (2 * np.pi)) < 1e-9)
    True
    """
    # imported here, as sections are above
    from liouville._studies.section import Section

    if not isinstance(section, Section):
        raise TypeError(f"rotation numbers must be those of a section, not of {section!r}")
    names, normal = section.names, section.plane[0]
    if of is None:
        is_axis = np.count_nonzero(normal) == 1
        of = [name for k, name in enumerate(names) if not (is_axis and normal[k])]
        if len(of) != 2:
            sentence = f"of= must name two coordinates: there are {', '.join(of)}"
            raise ValueError(hinted(sentence, f"write of=({of[0]!r}, {of[-1]!r})"))
    places = [names.index(name) if name in names else -1 for name in of]
    if len(places) != 2 or -1 in places:
        raise ValueError(f"of= must name two of {', '.join(names)}, not {tuple(of)!r}")
    centre = np.asarray(about, dtype=float)
    if centre.shape not in ((2,), (section.members, 2)):
        wanted = f"(2,) or ({section.members}, 2)"
        raise misshapen("about", centre.shape, wanted)
    if not np.isfinite(centre).all():
        raise ValueError(f"about must be finite, not {about!r}")
    centre = np.broadcast_to(centre, (section.members, 2))
    found, is_around = np.full(section.members, np.nan), []
    for member in range(section.members):
        away = section.x[section.member == member][:, places] - centre[member]
        if len(away) >= FEWEST:
            angles = np.arctan2(away[:, 1], away[:, 0])
            changes = np.remainder(np.diff(angles) + np.pi, 2 * np.pi) - np.pi
            found[member] = _mean_turn(changes)
            is_around.append(_is_around(changes))
    if is_around and not any(is_around):
        warnings.warn(
            f"no trajectory goes round about={about!r}: seen from there all crossings go to and "
            "fro within half a turn",
            stacklevel=2,
        )
    return found


def _is_around(changes: NDArray[np.float64]) -> bool:
    """Return whether angles go round, or may do so in a longer run."""
    angles = np.concatenate([[0.0], np.cumsum(changes)])
    return bool(np.ptp(angles) >= np.pi or changes.min() >= 0 or changes.max() <= 0)


def _mean_turn(changes: NDArray[np.float64]) -> float:
    """Return the mean of changes of an angle in turns, by weights that vanish at both ends."""
    s = (np.arange(changes.size) + 0.5) / changes.size
    weights = np.exp(-1 / (s * (1 - s)))
    return float(weights @ changes / (2 * np.pi * weights.sum()))
