"""Runs as functions of PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville.bridges.functions import run_function
from liouville.bridges.run import RunFunction, Runnable, library
from liouville.methods import Method
from liouville.runners import Request


def solver(
    system: Runnable,
    method: Method | str,
    *,
    wrt: Sequence[str],
    returns: str | Sequence[str] | None = None,
    t: tuple[float, float] | Sequence[float],
    h: float | None = None,
    steps: int | None = None,
    every: int = 1,
    params: Mapping[str, ArrayLike] | None = None,
    **start: ArrayLike,
) -> Callable[..., Any]:
    """Return a run as a function that PyTorch differentiates.

    It is a ``torch.autograd.Function``: ``backward`` takes the pullback of :func:`liouville.vjp`,
    and forward mode takes tangents. There are no derivatives of derivatives.

    Parameters
    ----------
    system, method, t, h, steps, every, params
        As for :func:`liouville.vjp`: a mechanical or semi-explicit system or a field with equal
        steps, whose number is that of `t`, also where its ends are inputs; or a Schrödinger
        equation, whose psi is complex.
    wrt : sequence of str
        What the run is a function of: states of the system such as ``"q"`` and ``"v"``,
        ``"params.name"``, ``"t0"`` and ``"t1"``, and ``"drive[k]"`` for the samples of a drive.
    returns : str or sequence of str, optional
        The states that it returns: those of the system, by default the first, or ``"lam"``.
    **start : array_like
        Start values that are not in `wrt`, each of shape (n,).

    Returns
    -------
    callable
        ``f(*tensors)`` with a tensor of ``torch.float64``, or a float, for each name in `wrt`, and
        one of ``torch.complex128`` for psi, whose gradient is that of :func:`liouville.vjp`. It
        returns a tensor for each name in `returns`, or one where that is a string: of shape (k, n),
        at the kept times, the start among them.
        It moves a start onto its constraints as ``system.consistent`` does, and derivatives are
        those of the start moved. Where some constraints imply others, they are taken at starts on
        all of them.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong, or what is asked for has no pullback; of the function, an input of
        another shape or type, or, of its derivatives, a start off the constraints.
    IntegrationError
        The function's run fails.
    ImportError
        PyTorch is missing.

    Examples
    --------
    .. code-block:: python

        end = lv.torch.solver(system, lv.Spark(3), wrt=["v", "params.l"], t=(0, 1), h=0.02, q=q)
        end(v, 2.0)[-1, 1].backward()  # v.grad is that of the height at the end
    """
    torch = library("torch", "lv.torch.solver")
    request = Request(
        t=t, h=h, steps=steps, every=every, params=params, start=start, has_pullback=True
    )  # fmt: skip
    function = run_function(system, method, wrt, returns, request)

    def solve(*inputs: Any) -> Any:
        double = torch.float64
        tensors = [torch.tensor(x, dtype=double) if isinstance(x, float) else x for x in inputs]
        for x in tensors:
            if not isinstance(x, torch.Tensor):
                raise TypeError(f"inputs are tensors of torch.float64 and floats, not {x!r}")
        function.check([(x.shape, str(x.dtype).removeprefix("torch.")) for x in tensors])
        found = _function().apply(function, *tensors)
        return found[0] if function.is_single else found

    return solve


@cache
def _function() -> Any:
    """Return the function of PyTorch that a run is."""
    torch = library("torch", "lv.torch.solver")
    base: Any = torch.autograd.Function

    def arrays(tensors: Sequence[Any]) -> list[Any]:
        return [x.detach().cpu().resolve_conj().resolve_neg().numpy() for x in tensors]

    def on(device: Any, values: Sequence[Any]) -> tuple[Any, ...]:
        return tuple(torch.from_numpy(np.array(x)).to(device) for x in values)

    class Run(base):  # type: ignore[misc]
        """A run, its pullback and its tangents."""

        @staticmethod
        def forward(ctx: Any, function: RunFunction, *inputs: Any) -> Any:
            ctx.point = function.at(arrays(inputs))
            ctx.device = inputs[0].device
            return on(ctx.device, ctx.point.values)

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
        def backward(ctx: Any, *cotangents: Any) -> Any:
            return None, *on(ctx.device, ctx.point.pulled(arrays(cotangents)))

        @staticmethod
        def jvp(ctx: Any, _: Any, *directions: Any) -> Any:
            zeros = map(np.zeros_like, ctx.point.inputs)
            own = [
                zero if x is None else arrays([x])[0]
                for zero, x in zip(zeros, directions, strict=True)
            ]
            return on(ctx.device, [x[0] for x in ctx.point.pushed([x[None] for x in own])])

    return Run
