"""Lyapunov exponents: how fast neighbouring trajectories part, by tangents of the steps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.arguments import amount, check_memory, count
from liouville._basics.errors import IntegrationError, Suggesting, hinted
from liouville._basics.options import started
from liouville._basics.progress import Progress, reported
from liouville._methods import Method, VolumeSplitting
from liouville._methods.control import Steps, Takes, steps_of
from liouville._methods.planner import plan as plan_of
from liouville._runs.choice import check_system
from liouville._runs.execute import finished
from liouville._runs.integrate import integrate
from liouville._solution.failure import counted_on
from liouville._systems import Field, Mechanics, System
from liouville.analysis.linearization import linearized_at
from liouville.analysis.point import Array, Point, Split

if TYPE_CHECKING:
    from liouville._methods.planner import Plan

#: Tangents are made orthogonal at equal steps alone.
TAKES = Takes("lyapunov", hint="give h or steps: tangents are of equal steps", times="")


#: Bytes of an orthogonalisation but for its exponents: its step and time, as Python numbers too.
HELD = 96

#: Directions whose parts across each other are below this are parallel.
LEAST = 1e-13


@dataclass(frozen=True, eq=False, repr=False)
class Lyapunov(Suggesting):
    """The exponents of a trajectory, and how they have settled.

    Attributes
    ----------
    exponents : ndarray, shape (d,)
        Mean growth rates of d orthogonal directions until the end, the largest first but for those
        that have not settled, in one over the system's unit of time.
    t : ndarray, shape (k,)
        Times at which the directions were made orthogonal again.
    history : ndarray, shape (k, d)
        The same means until each of these times.
    final : dict of str to ndarray
        The state at the end, by the system's names, to go on from.
    """

    exponents: Array
    t: Array
    history: Array
    final: dict[str, Array]

    @property
    def pairs(self) -> Array:
        """Sums of the first exponent and the last, the second and the last but one, and so on.

        They are zero for a Hamiltonian system, to roundoff at any time, if all were asked for.
        """
        sums: Array = self.exponents + self.exponents[::-1]
        return sums[: len(sums) // 2]

    def __repr__(self) -> str:
        """Return the number of exponents, the largest, and when the run ended."""
        return (
            f"<Lyapunov: {amount(len(self.exponents), 'exponent')} until t = {self.t[-1]:g}, "
            f"the largest {self.exponents.max():.6g}>"
        )


def lyapunov(
    system: System,
    method: Method | Plan | str = "auto",
    *,
    t: tuple[float, float],
    h: float | None = None,
    steps: int | None = None,
    every: int = 10,
    exponents: int | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    progress: Progress = None,
    start: Mapping[str, ArrayLike] | None = None,
    **values: ArrayLike,
) -> Lyapunov:
    r"""Compute Lyapunov exponents of a mechanical system, on its constraints, or of a field.

    Tangents of the discrete solution are stepped with it, and made orthogonal by :math:`W = Q R`
    again and again; the exponents are

    .. math::

        \lambda_i = \frac{1}{t_1 - t_0} \sum \ln R_{ii}

    Those of a mechanical system with n coordinates and m constraints are 2 (n - m): directions are
    (dy, dp) with dp the part of the momentum's change that is tangential to the constraints. In
    these coordinates the step of a Hamiltonian system is symplectic, the directions begin as an
    orthogonal symplectic basis, and exponents come in pairs of opposite sign whatever the time. The
    unit of dy, whose inverse is that of dp, is the one in which the two drive each other alike at
    the start: no result depends on the units of the model. The
    exponents of a divergence-free field sum to zero. The first n - m directions begin as changes of
    positions alone: with :math:`H = z \cdot F(y)` and z = 0 their exponents are those of
    :math:`y' = F(y)`, whatever that is.

    Parameters
    ----------
    system : Mechanics, PolynomialField, GriddedField or PotentialField
        What moves, without nonholonomic constraints.
    method : Method or Plan
        ``Spark``, ``LobattoPair`` or a ``Composition`` of them; also of the alpha family, without
        pairs to roundoff; ``VolumeSplitting`` or a plan.
    t, h, steps, params, progress
        As for :func:`liouville.integrate`, with equal steps, forward in time.
    every : int, default 10
        Steps between two orthogonalisations; directions must not grow by more than 1e10 between.
    exponents : int, optional
        How many of the largest are wanted; all by default.
    start, **values : mapping, or array_like by name
        The start, by the system's names, on its constraints.

    Returns
    -------
    Lyapunov
        The exponents and their history.

    Raises
    ------
    TypeError, ValueError
        The system or the method has no tangents, the start is off its constraints, or there are not
        so many exponents.
    MemoryError
        The history would not fit in memory.
    IntegrationError
        A step failed.
    KeyboardInterrupt
        The run was interrupted: exponents of a part of the time are not those of the whole.

    References
    ----------
    :cite:t:`benettin1980`; the coordinates on constraints are those of :doc:`/theory/adjoint`.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import abc_flow
    >>> found = lv.analysis.lyapunov(
    ...     abc_flow.system, lv.VolumeSplitting(), t=(0, 5), h=0.1, x=[0.1, 0.2, 0.3]
    ... )
    >>> bool(abs(found.exponents.sum()) < 1e-12)
    True
    """
    check_system(system)
    plan = steps_of(t, h, steps, TAKES)
    if plan.t1 < plan.t0:
        raise ValueError(hinted("t runs backwards", "exponents are those of the time ahead"))
    segment = min(count("every", every), plan.count)
    flow = _flow_of(system, method, plan.mean(plan.t1, plan.count), params)
    flow.begin(plan, started(start, values))
    most = flow.moved.shape[1]
    wanted = most if exponents is None else count("exponents", exponents)
    if wanted > most:
        raise ValueError(f"there are {most} exponents, not {wanted}")
    flow.moved = flow.moved[:, :wanted]
    pieces = -(-plan.count // segment)
    check_memory(
        f"a history of {pieces} orthogonalisations", (HELD + 8 * wanted) * pieces,
        "give a larger every=, or fewer steps",
    )  # fmt: skip
    ends = [*range(segment, plan.count, segment), plan.count]
    h = plan.mean(plan.t1, plan.count)
    times = np.array([plan.t0 + end * h for end in ends])
    times[-1] = plan.t1
    history, total = np.empty((len(ends), wanted)), np.zeros(wanted)
    with reported(progress, "steps") as call:
        for k, t0 in enumerate([plan.t0, *times[:-1].tolist()]):
            done = ends[k - 1] if k else 0
            try:
                flow.advance((t0, float(times[k])), ends[k] - done)
            except IntegrationError as error:
                own = error.step, ends[k] - done
                raise IntegrationError(
                    counted_on(str(error), *own, done, plan.count), t=error.t,
                    step=done + error.step, quantity=error.quantity, solution=error.solution,
                ) from error.__cause__  # fmt: skip
            except KeyboardInterrupt:
                sentence = f"interrupted after at least {done} of {plan.count} steps"
                raise KeyboardInterrupt(sentence) from None
            total += flow.stretched(float(times[k]))
            history[k] = total / (times[k] - plan.t0)
            if call is not None:
                call(ends[k], plan.count)
    return Lyapunov(history[-1].copy(), times, history, dict(flow.state))


def _flow_of(
    system: System, method: Method | Plan | str, h: float, params: Mapping[str, ArrayLike] | None
) -> _Flow:
    if isinstance(system, Mechanics):
        if system.nonholonomic:
            sentence = f"exponents go without nonholonomic constraints: '{system.nonholonomic[0]}'"
            hint = "their motions have no symplectic form; tangents= of integrate has derivatives"
            raise TypeError(hinted(sentence, hint))
        return _Mechanical(system, method, params)
    if isinstance(system, Field):
        return _Field(system, method, h, params)
    sentence = (
        f"exponents must be those of a mechanical system or a polynomial field, not of {system!r}"
    )
    raise TypeError(hinted(sentence, "a wave function moves linearly: all its exponents are 0"))


class _Flow(ABC):
    """A system on its way, with directions as columns of `moved`, in the order of its states."""

    state: dict[str, Any]
    moved: Array

    def __init__(
        self, system: System, method: Method | Plan | str, params: Mapping[str, ArrayLike] | None
    ) -> None:
        self.system, self.method, self.params = system, method, params

    @abstractmethod
    def begin(self, plan: Steps, start: Mapping[str, ArrayLike]) -> None:
        """Take a start, and directions that are orthonormal in the coordinates of the exponents."""

    @abstractmethod
    def coordinates(self, t: float) -> Array:
        """Return the directions in the coordinates of the exponents."""

    def advance(self, t: tuple[float, float], steps: int) -> None:
        """Make steps with all directions."""
        cuts = np.cumsum([len(value) for value in self.state.values()])[:-1]
        rows = map(np.ascontiguousarray, np.split(self.moved.T, cuts, axis=1))
        run = finished(integrate(
            self.system, self.method, t=t, steps=steps, every=steps, params=self.params,
            tangents=dict(zip(self.state, rows, strict=True)), **self.state,
        ))  # fmt: skip
        # a direction of all states is the sum of its parts
        found = [
            sum(tangent.states[name][-1] for tangent in run.tangents.values())
            for name in self.state
        ]
        self.moved = np.hstack(found).T
        self.state = {name: run.states[name][-1].copy() for name in self.state}

    def stretched(self, t: float) -> Array:
        """Make the directions orthonormal, and return the logarithms of their growth."""
        _, upper = np.linalg.qr(self.coordinates(t))
        sizes = np.diagonal(upper)
        if not np.all(np.abs(sizes) > LEAST * np.abs(upper).max()):
            sentence = f"directions have become parallel before t = {t:g}"
            raise ValueError(hinted(sentence, "make them orthogonal more often: a smaller every"))
        self.moved = np.linalg.solve(upper.T, self.moved.T).T * np.sign(sizes)
        found: Array = np.log(np.abs(sizes))
        return found


class _Field(_Flow):
    """A field: its directions are their own coordinates."""

    system: Field

    def __init__(
        self,
        system: Field,
        method: Method | Plan | str,
        h: float,
        params: Mapping[str, ArrayLike] | None,
    ) -> None:
        super().__init__(system, method, params)
        self.h = h

    def begin(self, plan: Steps, start: Mapping[str, ArrayLike]) -> None:
        """Take a start, with the directions of the axes."""
        t = plan.t0
        x = self.system.start(start, False)
        if isinstance(self.method, VolumeSplitting):  # planned once, not for each run
            self.method = plan_of(self.system, self.method, h=self.h, x=x, t=t, params=self.params)
        self.state, self.moved = {"x": x}, np.eye(len(x))

    def coordinates(self, t: float) -> Array:
        """Return the directions."""
        del t
        return self.moved


class _Mechanical(_Flow):
    """A mechanical system: its directions are (dy, dz), their coordinates (dy, tangential dp)."""

    system: Mechanics
    unit: float

    def begin(self, plan: Steps, start: Mapping[str, ArrayLike]) -> None:
        """Take a start, with an orthogonal symplectic basis of directions."""
        y, z = self.system.start(start)
        self.state = dict(zip(self.system.states, (y, z), strict=True))
        point = self._point(plan.t0)
        point.check()
        linear = linearized_at(point)
        self.moved, self.unit = linear.tangent, 1.0
        null = self._free(point)
        n, k = null.shape
        basis = np.zeros((2 * n, 2 * k))
        basis[:n, :k], basis[n:, k:] = null, null
        own = basis.T @ self.coordinates(plan.t0)
        sizes = np.abs(own).max(axis=1)
        back = np.linalg.inv(own / sizes[:, None]) / sizes  # momenta are in another unit
        self.unit = _unit_of(own @ linear.state @ back, plan.t1 - plan.t0)
        back[:, :k] *= self.unit
        back[:, k:] /= self.unit
        order = [*range(k), *reversed(range(k, 2 * k))]
        self.moved = (linear.tangent @ back)[:, order]

    def coordinates(self, t: float) -> Array:
        """Return the changes of positions, and of the momenta along the constraints, in units."""
        point, n = self._point(t), len(self.system.coordinates)
        dy, dz = self.moved[:n], self.moved[n:]
        dp = point.blocks("stage_blocks")["p_z"] @ dz
        by_position = point.blocks("stage_jacobian").get("p_y")
        if by_position is not None:
            dp = dp + by_position @ dy
        null, units = self._free(point), point.units[:, None]
        return np.vstack([dy / units / self.unit, self.unit * (null @ (null.T @ (units * dp)))])

    def _point(self, t: float) -> Point:
        y, z = self.state.values()
        return Point(self.system, t, y, z, self.system.values(self.params))

    @staticmethod
    def _free(point: Point) -> Array:
        """Return an orthonormal basis of the free directions, coordinates in their units."""
        gradients = point.blocks("node_blocks", np.zeros(point.m))["g_y"]
        return Split.of(gradients * point.units).null


def _unit_of(rates: Array, span: float) -> float:
    """Return the unit of dy, its inverse that of dp, in which the two drive each other alike.

    So exponents until a given time are the same in all units of length, mass and time. Of the
    matrix of (dy, dp)' those two blocks count; slower motion than one over the span does not.
    """
    half = len(rates) // 2
    by_momentum, by_position = (
        float(np.linalg.norm(block, 2)) for block in (rates[:half, half:], rates[half:, :half])
    )
    rate = max(np.sqrt(by_momentum * by_position), 1 / span)
    if by_momentum > 0:
        return float(np.sqrt(by_momentum / rate))
    return float(np.sqrt(rate / by_position)) if by_position > 0 else 1.0
