"""Runs as functions of JAX."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.errors import hinted
from liouville._basics.options import started
from liouville._bridges.members import RunMembers
from liouville._bridges.run import FIRST, RunFunction, Runnable, library
from liouville._bridges.solver import Solver
from liouville._methods import Method
from liouville._runs.runner import Request
from liouville._systems.events import Event

#: The setting that enables numbers of 64 bits.
SWITCH = 'jax.config.update("jax_enable_x64", True) before the first array'


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
) -> Callable[..., Any]:
    """Return a run as a function that JAX differentiates, compiles and maps.

    ``jax.grad`` and ``jax.vjp`` take the pullback of :func:`liouville.vjp`, ``jax.jvp`` and
    ``jax.jacfwd`` take tangents, all directions at a point in one run. ``jax.jit`` and ``jax.vmap``
    work on all of them: values and gradients that are mapped over starts and parameters are those
    of one ensemble. Mapped over an end of a run, or over samples of a drive, they are runs one
    after another, as are directions that differ from start to start. There are no
    derivatives of derivatives.

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
    callable
        ``f(*arrays)`` with an array for each name in `wrt`, of float64, psi of complex128, or by
        keywords, ``f(q, l=2)`` for ``"params.l"``; whole numbers are taken as floats. It returns an
        array for each name in `returns`, or one where that is a string: of shape (k, n), at the
        kept times, the start among them. Cotangents and gradients of psi are those of JAX's
        convention, the conjugates of those of :func:`liouville.vjp`. Of members that are mapped
        those that fail have NaN, and ``f.failures`` says why. It can be pickled where the system
        can.
        It moves a start onto its constraints as ``system.consistent`` does, and derivatives are
        those of the start moved. Where some constraints imply others, they are taken at starts on
        all of them.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong, or what is asked for has no pullback; of the function, an input of
        another shape or type, or numbers of 64 bits that are switched off. Where a run fails, or
        its start cannot be differentiated, it may be JAX's own error that has the sentence.
    ImportError
        JAX is missing.

    Examples
    --------
    .. code-block:: python

        end = lv.jax.solver(system, lv.Spark(3), wrt=["v", "params.l"], t=(0, 1), h=0.02, q=q)
        jax.grad(lambda v, l: end(v, l)[-1, 1])(v, 2.0)  # of the height at the end
    """
    request = Request(
        t=t, h=h, steps=steps, rtol=rtol, every=every, t_eval=t_eval, events=events, params=params,
        start=started(start, values), has_pullback=True,
    )  # fmt: skip
    library("jax", "lv.jax.solver")
    return JaxSolver(system, method, wrt, returns, request)


class JaxSolver(Solver):
    """A run as a function of JAX; see :func:`solver`."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        function = self._function
        jax = library("jax", "lv.jax.solver")

        def evaluated(*inputs: Any) -> list[Any]:
            return function.mapped(inputs, lambda at, _: at.values)

        @jax.custom_jvp  # type: ignore[untyped-decorator]
        def run(*inputs: Any) -> Any:
            shapes = _results(function, (), is_transposed=False)
            return jax.pure_callback(evaluated, shapes, *inputs, vmap_method="broadcast_all")

        @run.defjvp  # type: ignore[untyped-decorator]
        def run_jvp(inputs: Any, directions: Any) -> Any:
            options = {"function": function, "is_transposed": False, "lead": ()}
            return run(*inputs), _derivative().bind(*inputs, *directions, **options)

        self._run = run

    def __call__(self, *inputs: Any, **named: Any) -> Any:
        """Return the states in `returns` for inputs in the order of `wrt` or by their names."""
        jax = library("jax", "lv.jax.solver")
        if not jax.config.jax_enable_x64:
            raise ValueError(hinted("JAX has numbers of 32 bits, and runs take 64", SWITCH))
        arrays = [_floats(jax.numpy, x) for x in self._function.ordered(inputs, named)]
        self._function.check([(x.shape, str(x.dtype)) for x in arrays])
        found = self._run(*arrays)
        return found[0] if self._function.is_single else tuple(found)


def _floats(numpy: Any, x: Any) -> Any:
    """Return an array, with whole numbers as floats of 64 bits."""
    array = numpy.asarray(x)
    return array.astype("float64") if array.dtype.kind in "iu" else array


def _results(function: RunFunction, lead: tuple[int, ...], is_transposed: bool) -> list[Any]:
    """Return shapes and types of what a derivative gives, after axes of members."""
    jax = library("jax", "lv.jax.solver")
    parts = function.inputs if is_transposed else function.outputs
    kinds = function.types
    return [jax.ShapeDtypeStruct((*lead, *shape), kinds[name]) for name, shape in parts.items()]


@cache
def _derivative() -> Any:
    r"""Return JAX's primitive of the derivative of a run, and of its transpose.

    It takes the inputs of the run, then directions of them or cotangents of its outputs, all with
    the axes `lead` of members; it is linear in the latter. The pairing of JAX is that of
    :math:`\Re \sum c\, d`, and that of the library of :math:`\Re \sum \bar c\, d`. One
    function, since every rule that JAX is given names the primitive.
    """
    jax = library("jax", "lv.jax.solver")
    from jax.extend.core import Primitive
    from jax.interpreters import ad, batching, mlir

    derivative = Primitive("liouville_run_derivative")
    derivative.multiple_results = True

    def call(*args: Any, function: RunFunction, is_transposed: bool, lead: tuple[int, ...]) -> Any:
        def derived(at: RunMembers, linear: list[Any]) -> list[Any]:
            if not is_transposed:
                return at.pushed(linear)
            return [np.conj(x) for x in at.pulled([np.conj(x) for x in linear])]

        own = _results(function, lead, is_transposed)
        return jax.pure_callback(
            lambda *args: function.mapped(args, derived), own, *args, vmap_method="sequential"
        )

    def abstract(*args: Any, function: RunFunction, is_transposed: bool, lead: Any) -> list[Any]:
        own = _results(function, lead, is_transposed)
        return [jax.core.ShapedArray(x.shape, x.dtype) for x in own]

    def transpose(
        found: Any, *args: Any, function: RunFunction, is_transposed: bool, lead: Any
    ) -> list[Any]:
        count = len(function.inputs)
        inputs, linear = args[:count], args[count:]
        whole = [ad.instantiate_zeros(x) for x in found]
        options = {"function": function, "is_transposed": not is_transposed, "lead": lead}
        own = zip(linear, derivative.bind(*inputs, *whole, **options), strict=True)
        return [None] * count + [x if ad.is_undefined_primal(to) else None for to, x in own]

    def jvp(args: Any, tangents: Any, function: RunFunction, **options: Any) -> Any:
        count = len(function.inputs)
        if any(type(x) is not ad.Zero for x in tangents[:count]):
            raise NotImplementedError(FIRST)
        linear = [ad.instantiate_zeros(x) for x in tangents[count:]]
        options["function"] = function
        return derivative.bind(*args, **options), derivative.bind(*args[:count], *linear, **options)

    def batch(args: Any, axes: Any, lead: Any, **options: Any) -> Any:
        mapped = zip(args, axes, strict=True)
        size = next(x.shape[axis] for x, axis in mapped if axis is not None)
        rows = [
            jax.numpy.broadcast_to(x, (size, *x.shape)) if axis is None
            else jax.numpy.moveaxis(x, axis, 0)
            for x, axis in zip(args, axes, strict=True)
        ]  # fmt: skip
        found = derivative.bind(*rows, lead=(size, *lead), **options)
        return found, [0] * len(found)

    derivative.def_impl(call)
    derivative.def_abstract_eval(abstract)
    ad.primitive_jvps[derivative] = jvp
    ad.primitive_transposes[derivative] = transpose
    batching.primitive_batchers[derivative] = batch
    mlir.register_lowering(derivative, mlir.lower_fun(call, multiple_results=True))
    return derivative
