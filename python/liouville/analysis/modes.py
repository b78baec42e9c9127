"""Natural modes of small vibrations about an equilibrium."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics import html
from liouville._basics.arguments import count as counted
from liouville._basics.errors import Suggesting, hinted
from liouville._basics.options import started
from liouville._basics.scipy import scipy
from liouville._systems import Mechanics
from liouville.analysis.linearization import Linearization, linearized_at
from liouville.analysis.point import LARGE, Array, Point, mechanical
from liouville.analysis.sparse_modes import GROWTH, sparse_modes, with_double_zeros

Complex = NDArray[np.complex128]

#: Stiffness is symmetric, and damping none, up to this part of its size.
SYMMETRIC = 1e-10
#: Squares of frequencies below this part of the largest are zero.
ZERO = 1e-13
#: A repr shows so many modes.
SHOWN = 12


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Suggesting):
    r"""Modes :math:`\delta y = \operatorname{Re} \phi e^{\lambda t}` in the order of frequencies.

    Of a conjugate pair that with the positive imaginary part is listed. Without damping a mode with
    :math:`\lambda^2 > 0` is unstable; :math:`\lambda > 0` is listed and its decaying partner not.

    Attributes
    ----------
    eigenvalues : ndarray, shape (c,)
        :math:`\lambda`, complex, in radians per unit of time.
    shapes : ndarray, shape (n, c)
        :math:`\phi` in the coordinates of the system, a column each, with :math:`\phi^* M \phi = 1`
        and the largest entry positive. Real without damping and gyroscopic forces, else complex.
    coordinates : tuple of str
        Names of the n coordinates.
    """

    eigenvalues: Complex
    shapes: NDArray[Any]
    coordinates: tuple[str, ...]
    _point: Point = field(default=None)  # type: ignore[assignment]

    @property
    def angular_frequencies(self) -> Array:
        r"""Natural frequencies :math:`|\lambda|`, in radians per unit of time, shape (c,)."""
        found: Array = np.abs(self.eigenvalues)
        return found

    @property
    def hertz(self) -> Array:
        r"""Natural frequencies :math:`|\lambda| / 2 \pi`, hertz where time is in seconds, (c,)."""
        found: Array = self.angular_frequencies / (2 * np.pi)
        return found

    @property
    def damped_hertz(self) -> Array:
        r"""Frequencies with damping, :math:`\operatorname{Im} \lambda / 2 \pi`, shape (c,)."""
        found: Array = self.eigenvalues.imag / (2 * np.pi)
        return found

    @property
    def damping_ratios(self) -> Array:
        r"""Shares of critical damping, :math:`-\operatorname{Re} \lambda / |\lambda|`, shape (c,).

        One of overdamped modes, negative of unstable ones, zero where nothing vibrates.
        """
        size = self.angular_frequencies
        found: Array = 0.0 - self.eigenvalues.real / np.where(size > 0, size, 1.0)
        return found

    @property
    def unstable(self) -> tuple[int, ...]:
        """The modes that grow, by their numbers."""
        limit = GROWTH * self.angular_frequencies.max(initial=0.0)
        return tuple(np.flatnonzero(self.eigenvalues.real > limit).tolist())

    def body(self, name: str) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return how a body of an assembly moves in each mode.

        Parameters
        ----------
        name : str
            The body.

        Returns
        -------
        shift, turn : ndarray, each of shape (3, c)
            The displacement of its centre of mass, and its small turn as a vector, in the world.

        Raises
        ------
        TypeError, ValueError
            The system is not made of bodies, or there is no such body.
        """
        layout = getattr(self._point.system, "body_layout", None)
        if layout is None:
            kind = type(self._point.system).__name__
            hint = "its shapes are those of its coordinates"
            raise TypeError(hinted(f"a {kind} knows no bodies", hint))
        place = self._point.system.body(name)  # type: ignore[attr-defined]
        q = np.tile(self._point.y, (self.shapes.shape[1], 1))
        shift, turn = layout.twist(q, self.shapes.T, place)
        return np.stack(shift), np.stack(turn)

    def __len__(self) -> int:
        """Return the number of modes."""
        return len(self.eigenvalues)

    def __repr__(self) -> str:
        """List the first modes, with those that grow."""
        lines = [f" {' '.join(filter(None, row))}" for row in self._rows(SHOWN)]
        if len(self) > SHOWN:
            lines.append(f" and {len(self) - SHOWN} more")
        return f"<{self._headline}\n" + "\n".join(lines) + ">"

    def _repr_html_(self) -> str:
        """Show a table in a notebook."""
        heads = ("", "hertz", "rad / time", "damping ratio", "")
        return html.table(self._headline, self._rows(len(self)), heads)

    @property
    def _headline(self) -> str:
        grow = len(self.unstable)
        how = f"{grow} of them unstable" if grow else "none unstable"
        return f"Modes: {len(self)}, {how}"

    def _rows(self, most: int) -> list[tuple[str, ...]]:
        numbers = zip(self.hertz, self.angular_frequencies, self.damping_ratios, strict=True)
        return [
            (
                f"{k}:",
                f"{hertz:.6g} Hz",
                f"{angular:.6g} rad/time",
                f"damping {ratio:.3g}",
                "unstable" * (k in self.unstable),
            )
            for k, (hertz, angular, ratio) in enumerate(numbers)
            if k < most
        ]


def modes(
    system: Mechanics,
    *,
    count: int | None = None,
    t: float = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
    start: Mapping[str, Any] | None = None,
    **values: Any,
) -> Modes:
    r"""Compute the modes of small vibrations about an equilibrium or a steady motion.

    On the tangent space of the constraints, :math:`K \phi = \omega^2 M \phi`; with damping or
    gyroscopic forces the eigenvalues of the state matrix of :func:`linearize`. Of more than 1000
    coordinates the lowest modes are found by ARPACK from sparse matrices, whose constraints stay
    beside them, and sought beside those found until none is missing of equal frequency.

    Parameters
    ----------
    system : Mechanics
        A Lagrangian, Hamiltonian, Mechanical, Structure, or the system of an assembly.
    count : int, optional
        How many modes, the lowest ones; all by default, which systems of more than 1000 coordinates
        do not take.
    t : float, default 0
        Time, in the system's unit.
    params : mapping, optional
        Parameters that differ from their defaults.
    start, **values : mapping, or array_like by name
        The equilibrium by the system's names, each of shape (n,): ``**equilibrium(...).start``; at
        rest where the second is left out. A Structure needs none where it rests undeformed.

    Returns
    -------
    Modes
        Frequencies, damping ratios and shapes; unstable modes are among them and named.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong, the state is off its constraints, or it is no equilibrium.
    ImportError
        SciPy is not installed.

    References
    ----------
    :cite:t:`lehoucq1998` for ARPACK.

    Examples
    --------
    >>> import liouville as lv
    >>> lv.analysis.modes(lv.Structure([1.0, 1.0], [[2.0, -1.0], [-1.0, 2.0]]))
    <Modes: 2, none unstable
     0: 0.159155 Hz 1 rad/time damping 0
     1: 0.275664 Hz 1.73205 rad/time damping 0>
    """
    point = Point.given(mechanical(system, "modes"), started(start, values), t, params)
    wanted = None if count is None else counted("count", count)
    if point.n > LARGE:
        if wanted is None:
            sentence = f"count= says how many modes of {point.n} coordinates are wanted"
            raise TypeError(hinted(sentence, "count=20 gives the lowest twenty"))
        point.check()
        eigenvalues, shapes = sparse_modes(point, wanted)
    else:
        point.check()
        linear = linearized_at(point)
        _check_balanced(point, linear)
        eigenvalues, shapes = _dense_modes(point, linear)
    order = np.argsort(np.abs(eigenvalues), kind="stable")[:wanted]
    blocks = point.blocks("stage_blocks")
    mass = blocks["p_z"] @ np.linalg.inv(blocks["v_z"]) if "v_z" in blocks else blocks["p_z"]
    return Modes(
        eigenvalues[order].astype(complex),
        _normalised(shapes[:, order], mass),
        system.coordinates,
        point,
    )


def _check_balanced(point: Point, linear: Linearization) -> None:
    """Refuse a state whose forces are not in balance."""
    mass = point.blocks("stage_blocks")["p_z"]
    stiffness = float(np.abs(linear.stiffness).max(initial=0.0))
    point.check_balance(mass @ linear.acceleration, stiffness, point.units)


def _dense_modes(point: Point, linear: Linearization) -> tuple[Complex, NDArray[Any]]:
    """Return the modes of all freedoms, by real matrices where nothing damps or turns."""
    la = scipy("linalg", "modes")
    stiffness, mass, damping = linear.stiffness, linear.mass, linear.damping
    free, straying = stiffness.shape[1], np.inf
    if free == len(mass):  # s' by momenta or velocities, and by positions
        back = np.linalg.inv(linear.state[:free, free:])
        mass, damping = mass @ back, damping @ back
        straying = np.abs(linear.state[:free, :free]).max(initial=0.0)
    size = max(np.abs(stiffness).max(initial=0.0), 1e-300)
    heavy = max(np.abs(mass).max(initial=0.0), 1e-300)
    if (
        straying <= SYMMETRIC * np.sqrt(size / heavy)
        and np.abs(damping).max(initial=0.0) <= SYMMETRIC * np.sqrt(size * heavy)
        and np.abs(mass - mass.T).max() <= SYMMETRIC * heavy
        and np.abs(stiffness - stiffness.T).max() <= SYMMETRIC * size
    ):
        squares, ways = la.eigh((stiffness + stiffness.T) / 2, (mass + mass.T) / 2)
        squares[np.abs(squares) <= ZERO * np.abs(squares).max(initial=0.0)] = 0.0
        found = 1j * np.sqrt(squares.astype(complex))
        # i times the root of a negative number decays: the growing partner is listed
        return np.where(squares < 0, -found, found), linear.basis @ ways
    eigenvalues, ways = la.eig(linear.state)
    # a coordinate that nothing pushes has zero twice, and not a growth and a decay of roundoff
    eigenvalues = with_double_zeros(eigenvalues, np.abs(eigenvalues).max(initial=0.0))
    kept = eigenvalues.imag >= 0
    return eigenvalues[kept], (linear.tangent @ ways)[: point.n, kept]


def _normalised(shapes: NDArray[Any], mass: Any) -> NDArray[Any]:
    """Scale shapes to mass one, the largest entry of each positive."""
    sizes = np.sqrt(np.abs(np.sum(shapes.conj() * (mass @ shapes), axis=0)))
    columns = np.arange(shapes.shape[1])
    largest = shapes[np.argmax(np.abs(shapes), axis=0), columns]
    size = np.where(sizes > 0, sizes, 1.0) * largest / np.where(largest == 0, 1, np.abs(largest))
    found: NDArray[Any] = shapes / np.where(size == 0, 1, size)
    return found
