"""Runs as functions of CasADi."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._basics.options import started
from liouville._bridges.functions import run_function
from liouville._bridges.run import COMPLEX, FIRST, RunFunction, Runnable, RunPoint
from liouville._methods import Method
from liouville._runs.runner import Request
from liouville._systems.events import Event

Array = NDArray[Any]

#: Names with shapes of one side of a function, and what makes one side of the other.
Shapes = Sequence[tuple[str, tuple[int, int]]]
Call = Callable[[list[Array]], Sequence[Array]]

#: What helps where second derivatives are asked for.
SECOND = "IPOPT takes {'ipopt.hessian_approximation': 'limited-memory'}"


def solver(
    system: Runnable,
    method: Method | str,
    *,
    wrt: Sequence[str],
    returns: str | Sequence[str] | None = None,
    t: Sequence[Any] | NDArray[Any],
    h: float | None = None,
    steps: int | None = None,
    rtol: float | None = None,
    every: int = 1,
    t_eval: ArrayLike | None = None,
    events: Mapping[str, Event | Callable[..., Any]] | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    **values: ArrayLike,
) -> ca.Callback:
    """Return a run as a function of CasADi, for expressions in MX and for ``nlpsol``.

    Reverse derivatives take the pullback of :func:`liouville.vjp`, forward ones take tangents, all
    directions in one run. There are no second derivatives: IPOPT takes
    ``hessian_approximation="limited-memory"``.

    Parameters
    ----------
    system, method, t, h, steps, rtol, every, t_eval, events, params
        As for :func:`liouville.vjp`: a mechanical or semi-explicit system or a field with equal
        steps, whose number is that of `t`, also where its ends are inputs; or a Schrödinger
        equation, whose psi is complex. With `rtol` the states returned are those at `t_eval`, as
        the number of steps is not known before; events end no run. With contacts
        steps are equal, states those at their ends or at `t_eval`, and ends of runs no inputs.
    wrt : sequence of str
        What the run is a function of: states of the system such as ``"q"`` and ``"v"``,
        ``"params.name"``, ``"t0"`` and ``"t1"``, and ``"drive[k]"`` for the samples of a drive.
    returns : str or sequence of str, optional
        The states that it returns: those of the system, by default the first, or ``"lam"``.
    start, **values : mapping, or array_like by name
        Start values that are not in `wrt`, each of shape (n,).

    Returns
    -------
    casadi.Callback
        A function with an input for each name in `wrt`, columns of shape (n, 1) for vectors, and an
        output for each name in `returns`, of shape (k, n), at the kept times, the start among them.
        In the place of psi there are two, its real and its imaginary part.
        It moves a start onto its constraints as ``system.consistent`` does, and derivatives are
        those of the start moved. Where some constraints imply others, they are taken at starts on
        all of them.
        CasADi wants the function kept alive while it is in use.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong, or what is asked for has no pullback. Where a run fails, or its start
        cannot be differentiated, CasADi's RuntimeError has the sentence; IPOPT takes a shorter
        step there. CasADi prints the error to ``sys.stderr`` too, even where it is caught;
        ``contextlib.redirect_stderr`` takes it from there.

    Examples
    --------
    >>> import casadi as ca
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> end = lv.casadi.solver(
    ...     pendulum.system, lv.Spark(2), wrt=["params.g"], t=(0, 1), steps=50, every=50,
    ...     **pendulum.start,
    ... )
    >>> g = ca.MX.sym("g")
    >>> ca.Function("f", [g], [ca.gradient(end(g)[-1, 1], g)])(9.81).shape
    (1, 1)
    """
    request = Request(
        t=t, h=h, steps=steps, rtol=rtol, every=every, t_eval=t_eval, events=events, params=params,
        start=started(start, values), has_pullback=True,
    )  # fmt: skip
    return _Run(run_function(system, method, wrt, returns, request))


class _Called(ca.Callback):
    """A function of CasADi that Python evaluates, with the names and shapes of its two sides."""

    def __init__(
        self, name: str, ins: Shapes, outs: Shapes, call: Call, options: Mapping[str, Any]
    ) -> None:
        super().__init__()
        self._ins, self._outs, self._call = ins, outs, call
        self.construct(name, dict(options))

    def get_n_in(self) -> int:
        """Return how many inputs there are."""
        return len(self._ins)

    def get_n_out(self) -> int:
        """Return how many outputs there are."""
        return len(self._outs)

    def get_name_in(self, k: int) -> str:
        """Return the name of an input."""
        return self._ins[k][0]

    def get_name_out(self, k: int) -> str:
        """Return the name of an output."""
        return self._outs[k][0]

    def get_sparsity_in(self, k: int) -> ca.Sparsity:
        """Return the shape of an input."""
        return ca.Sparsity.dense(*self._ins[k][1])

    def get_sparsity_out(self, k: int) -> ca.Sparsity:
        """Return the shape of an output."""
        return ca.Sparsity.dense(*self._outs[k][1])

    def eval(self, given: Sequence[ca.DM]) -> list[ca.DM]:
        """Return the outputs."""
        try:
            return [ca.DM(x) for x in self._call([x.full() for x in given])]
        except Exception as error:
            # CasADi prints what is raised before an error of its own: the sentence will do
            raise error.with_traceback(None) from None

    def has_forward(self, count: int) -> bool:
        """Say that there are forward derivatives: without them CasADi has an error of its own."""
        return True

    def has_reverse(self, count: int) -> bool:
        """Say that there are reverse derivatives."""
        return True

    def get_forward(
        self, count: int, name: str, ins: Sequence[str], outs: Sequence[str], options: Any
    ) -> ca.Function:
        """Refuse derivatives of derivatives."""
        raise NotImplementedError(hinted(FIRST, SECOND))

    def get_reverse(
        self, count: int, name: str, ins: Sequence[str], outs: Sequence[str], options: Any
    ) -> ca.Function:
        """Refuse derivatives of derivatives."""
        raise NotImplementedError(hinted(FIRST, SECOND))


class _Run(_Called):
    """A run, with its derivatives, which live as long as it does."""

    def __init__(self, function: RunFunction) -> None:
        self._function = function
        self._derivatives: list[_Called] = []
        ins, outs = (_sides(function, shapes) for shapes in (function.inputs, function.outputs))

        def call(given: list[Array]) -> list[Array]:
            return _apart(self._at(given).values)

        super().__init__("run", ins, outs, call, {})

    def get_forward(
        self, count: int, name: str, ins: Sequence[str], outs: Sequence[str], options: Any
    ) -> ca.Function:
        """Return the derivatives by so many directions."""
        shapes = self._function.inputs

        def call(given: list[Array]) -> list[Array]:
            seeds = [np.stack(np.split(x, count, axis=1)) for x in given[-len(self._ins) :]]
            own = zip(self._together(seeds, shapes), shapes.values(), strict=True)
            directions = [x.reshape(count, *shape) for x, shape in own]
            found = _apart(self._at(given).pushed(directions))
            return [np.concatenate([*x], axis=1) for x in found]

        return self._derivative(self._ins, self._outs, count, call, (name, ins, outs, options))

    def get_reverse(
        self, count: int, name: str, ins: Sequence[str], outs: Sequence[str], options: Any
    ) -> ca.Function:
        """Return the derivatives of so many scalars."""
        outputs, shapes = self._function.outputs, [shape for _, shape in self._ins]

        def call(given: list[Array]) -> list[Array]:
            seeds = [np.split(x, count, axis=1) for x in given[-len(self._outs) :]]
            at, rows = self._at(given), zip(*seeds, strict=True)
            found = [_apart(at.pulled(self._together(row, outputs))) for row in rows]
            each = zip(zip(*found, strict=True), shapes, strict=True)
            return [np.hstack([x.reshape(shape) for x in own]) for own, shape in each]

        return self._derivative(self._outs, self._ins, count, call, (name, ins, outs, options))

    def _at(self, given: Sequence[Array]) -> RunPoint:
        shapes = self._function.inputs
        own = zip(self._together(given[: len(self._ins)], shapes), shapes.values(), strict=True)
        return self._function.at([x.reshape(shape) for x, shape in own])

    def _together(self, given: Sequence[Array], names: Mapping[str, Any]) -> list[Array]:
        """Make complex arrays of the real and imaginary parts of those that are complex."""
        parts, types = iter(given), self._function.types
        return [
            next(parts) + 1j * next(parts) if types[x] == COMPLEX else next(parts) for x in names
        ]

    def _derivative(
        self, taken: Shapes, made: Shapes, count: int, call: Call, names: Any
    ) -> ca.Function:
        """Return a function from inputs, outputs and what is taken, `count` times side by side."""

        def wide(shapes: Shapes) -> list[tuple[int, int]]:
            return [(rows, count * columns) for _, (rows, columns) in shapes]

        name, ins, outs, options = names
        sizes = [shape for _, shape in [*self._ins, *self._outs]] + wide(taken)
        own_ins, own_outs = zip(ins, sizes, strict=True), zip(outs, wide(made), strict=True)
        found = _Called(name, [*own_ins], [*own_outs], call, options)
        self._derivatives.append(found)
        return found


def _sides(function: RunFunction, shapes: Mapping[str, tuple[int, ...]]) -> Shapes:
    """Return names and shapes as CasADi takes them, real and imaginary parts each with its own."""
    found = []
    for k, (name, shape) in enumerate(shapes.items()):
        ends = ("_re", "_im") if function.types[name] == COMPLEX else ("",)
        found += [(_name(name, k) + end, _matrix(shape)) for end in ends]
    return found


def _apart(values: Sequence[Array]) -> list[Array]:
    """Return real arrays, of complex ones their real and imaginary parts."""
    return [part for x in values for part in ((x.real, x.imag) if np.iscomplexobj(x) else (x,))]


def _name(name: str, k: int) -> str:
    """Return the name of an input as CasADi takes it."""
    found = name.replace(".", "_").replace("[", "_").replace("]", "")
    return found if ca.Function.check_name(found) else f"i{k}"


def _matrix(shape: tuple[int, ...]) -> tuple[int, int]:
    """Return the shape of a number, a vector or a matrix as that of a matrix."""
    rows, columns = (*shape, 1, 1)[:2]
    return rows, columns
