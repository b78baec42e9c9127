"""Runs as functions of JAX."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville.bridges.run import DOUBLE, RunFunction, library
from liouville.errors import hinted
from liouville.methods import Method
from liouville.runners import Request
from liouville.systems import Mechanics

#: What switches numbers of 64 bits on.
SWITCH = 'jax.config.update("jax_enable_x64", True) before the first array'


def solver(
    system: Mechanics,
    method: Method,
    *,
    wrt: Sequence[str],
    returns: str | Sequence[str] = "q",
    t: tuple[float, float],
    h: float | None = None,
    steps: int | None = None,
    every: int = 1,
    params: Mapping[str, ArrayLike] | None = None,
    **start: ArrayLike,
) -> Callable[..., Any]:
    """Return a run as a function that JAX differentiates, compiles and maps.

    ``jax.grad`` and ``jax.vjp`` take the pullback of :func:`liouville.vjp`, ``jax.jvp`` and
    ``jax.jacfwd`` take tangents; ``jax.jit`` and ``jax.vmap`` work on all of them, ``vmap`` as one
    run after another. There are no derivatives of derivatives.

    Parameters
    ----------
    system, method, t, h, steps, every, params
        As for :func:`liouville.vjp`, with equal steps. Their number is that of `t`, also where its
        ends are inputs.
    wrt : sequence of str
        What the run is a function of: states of the system such as ``"q"`` and ``"v"``,
        ``"params.name"``, ``"t0"`` and ``"t1"``.
    returns : str or sequence of str
        The states that it returns: those of the system, or ``"lam"``.
    **start : array_like
        Start values that are not in `wrt`, each of shape (n,).

    Returns
    -------
    callable
        ``f(*arrays)`` with an array for each name in `wrt`, of float64. It returns an array for
        each name in `returns`, or one where that is a string: of shape (k, n), at the kept times,
        the start among them.
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
    jax = library("jax", "lv.jax.solver")
    request = Request(
        t=t, h=h, steps=steps, every=every, params=params, start=start, has_pullback=True
    )  # fmt: skip
    function = RunFunction(system, method, wrt, returns, request)
    shapes = [jax.ShapeDtypeStruct(shape, DOUBLE) for shape in function.outputs.values()]

    def values(*inputs: Any) -> list[Any]:
        return function.at(inputs).values

    @jax.custom_jvp  # type: ignore[untyped-decorator]
    def run(*inputs: Any) -> Any:
        return jax.pure_callback(values, shapes, *inputs, vmap_method="sequential")

    @run.defjvp  # type: ignore[untyped-decorator]
    def run_jvp(inputs: Any, directions: Any) -> Any:
        moved = _derivative().bind(*inputs, *directions, function=function, transposed=False)
        return run(*inputs), moved

    def solve(*inputs: Any) -> Any:
        if not jax.config.jax_enable_x64:
            raise ValueError(hinted("JAX has numbers of 32 bits, and runs take 64", SWITCH))
        arrays = [jax.numpy.asarray(x) for x in inputs]
        function.check([(x.shape, str(x.dtype)) for x in arrays])
        found = run(*arrays)
        return found[0] if function.is_single else tuple(found)

    return solve


@cache
def _derivative() -> Any:
    """Return JAX's primitive of the derivative of a run, and of its transpose.

    It takes the inputs of the run, then directions of them or cotangents of its outputs; it is
    linear in the latter. One function, since every rule that JAX is given names the primitive.
    """
    jax = library("jax", "lv.jax.solver")
    from jax.extend.core import Primitive
    from jax.interpreters import ad, batching, mlir

    derivative = Primitive("liouville_run_derivative")
    derivative.multiple_results = True

    def shapes(function: RunFunction, transposed: bool) -> list[Any]:
        parts = function.inputs if transposed else function.outputs
        return [jax.ShapeDtypeStruct(shape, DOUBLE) for shape in parts.values()]

    def call(*args: Any, function: RunFunction, transposed: bool) -> Any:
        count = len(function.inputs)

        def derived(*args: Any) -> list[Any]:
            point, linear = function.at(args[:count]), [np.asarray(x) for x in args[count:]]
            if transposed:
                return point.pulled(linear)
            return [x[0] for x in point.pushed([x[None] for x in linear])]

        own = shapes(function, transposed)
        return jax.pure_callback(derived, own, *args, vmap_method="sequential")

    def abstract(*args: Any, function: RunFunction, transposed: bool) -> list[Any]:
        parts = function.inputs if transposed else function.outputs
        return [jax.core.ShapedArray(shape, np.dtype(DOUBLE)) for shape in parts.values()]

    def transpose(found: Any, *args: Any, function: RunFunction, transposed: bool) -> list[Any]:
        count = len(function.inputs)
        inputs, linear = args[:count], args[count:]
        whole = [ad.instantiate_zeros(x) for x in found]
        back = derivative.bind(*inputs, *whole, function=function, transposed=not transposed)
        own = zip(linear, back, strict=True)
        return [None] * count + [x if ad.is_undefined_primal(to) else None for to, x in own]

    def jvp(args: Any, tangents: Any, function: RunFunction, transposed: bool) -> Any:
        count = len(function.inputs)
        if any(type(x) is not ad.Zero for x in tangents[:count]):
            raise NotImplementedError("a run has first derivatives only, and no second ones")
        linear = [ad.instantiate_zeros(x) for x in tangents[count:]]
        options = {"function": function, "transposed": transposed}
        return derivative.bind(*args, **options), derivative.bind(*args[:count], *linear, **options)

    def batch(args: Any, axes: Any, **options: Any) -> Any:
        mapped = [k for k, axis in enumerate(axes) if axis is not None]

        def one(rows: Any) -> Any:
            own = list(args)
            for k, row in zip(mapped, rows, strict=True):
                own[k] = row
            return derivative.bind(*own, **options)

        rows = [jax.numpy.moveaxis(args[k], axes[k], 0) for k in mapped]
        found = jax.lax.map(one, rows)
        return found, [0] * len(found)

    derivative.def_impl(call)
    derivative.def_abstract_eval(abstract)
    ad.primitive_jvps[derivative] = jvp
    ad.primitive_transposes[derivative] = transpose
    batching.primitive_batchers[derivative] = batch
    mlir.register_lowering(derivative, mlir.lower_fun(call, multiple_results=True))
    return derivative
