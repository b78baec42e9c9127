"""Runs as functions of PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.errors import hinted
from liouville._basics.options import started
from liouville._bridges.members import Call, RunMembers
from liouville._bridges.run import FIRST, RunFunction, Runnable, library
from liouville._bridges.solver import Solver
from liouville._methods import Method
from liouville._runs.runner import Request
from liouville._systems.events import Event


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
    """Return a run as a function that PyTorch differentiates.

    It is a ``torch.autograd.Function``: ``backward`` takes the pullback of :func:`liouville.vjp`,
    and forward mode takes tangents. The functions of ``torch.func`` work on it, and ``vmap`` of
    values and gradients over starts and parameters is one ensemble. Derivatives are linear
    functions of cotangents and directions, which PyTorch differentiates by these; there are no
    derivatives of derivatives by the inputs. ``torch.compile`` is to leave it alone, as
    ``torch.compiler.disable(f)``.

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
        ``f(*tensors)`` with a tensor of ``torch.float64``, or a number, for each name in `wrt`, and
        one of ``torch.complex128`` for psi, whose gradient is that of :func:`liouville.vjp`; or by
        keywords, ``f(q, l=2)`` for ``"params.l"``; whole numbers are taken as floats. It returns a
        tensor for each name in `returns`, or one where that is a string: of shape (k, n), at the
        kept times, the start among them. Of members that are mapped those that fail have NaN, and
        ``f.failures`` says why. It can be pickled where the system can.
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
    NotImplementedError
        A derivative is differentiated by the inputs.
    ImportError
        PyTorch is missing.

    Examples
    --------
    .. code-block:: python

        end = lv.torch.solver(system, lv.Spark(3), wrt=["v", "params.l"], t=(0, 1), h=0.02, q=q)
        end(v, 2.0)[-1, 1].backward()  # v.grad is that of the height at the end
    """
    library("torch", "lv.torch.solver")
    if isinstance(params, Mapping):
        params = {name: _fixed(f"params.{name}", x) for name, x in params.items()}
    given = {name: _fixed(name, x) for name, x in started(start, values).items()}
    request = Request(
        t=t, h=h, steps=steps, rtol=rtol, every=every, t_eval=t_eval, events=events, params=params,
        start=given, has_pullback=True,
    )  # fmt: skip
    return TorchSolver(system, method, wrt, returns, request)


class TorchSolver(Solver):
    """A run as a function of PyTorch; see :func:`solver`."""

    def __call__(self, *inputs: Any, **named: Any) -> Any:
        """Return the states in `returns` for inputs in the order of `wrt` or by their names."""
        torch, function = library("torch", "lv.torch.solver"), self._function
        given = function.ordered(inputs, named)
        places = [x.device for x in given if isinstance(x, torch.Tensor)]
        tensors = [_tensor(x, *places[:1]) for x in given]
        function.check([(x.shape, str(x.dtype).removeprefix("torch.")) for x in tensors])
        found = _function().apply(function, *tensors)
        return found[0] if function.is_single else found


def _tensor(x: Any, *place: Any) -> Any:
    """Return a tensor; numbers, and whole ones in tensors, are floats of 64 bits there."""
    torch = library("torch", "lv.torch.solver")
    if isinstance(x, float | int | np.number):
        return torch.tensor(float(x), dtype=torch.float64, device=place[0] if place else None)
    if not isinstance(x, torch.Tensor):
        raise TypeError(f"inputs must be tensors of torch.float64 and numbers, not {x!r}")
    is_whole = not (x.is_floating_point() or x.is_complex() or x.dtype == torch.bool)
    return x.double() if is_whole else x


def _fixed(name: str, value: Any) -> Any:
    """Return a copy of a tensor as an array, and anything else as it is.

    Raises
    ------
    TypeError
        It asks for a gradient that it would not have.
    """
    if not isinstance(value, library("torch", "lv.torch.solver").Tensor):
        return value
    if value.requires_grad:
        hint = f"write '{name}' into wrt and give it to the function, or give {name}.detach()"
        raise TypeError(hinted(f"'{name}' requires a gradient, and is fixed here", hint))
    return value.cpu().numpy().copy()


@cache
def _function() -> Any:
    """Return the function of PyTorch that a run is."""
    torch = library("torch", "lv.torch.solver")
    base: Any = torch.autograd.Function

    class Run(base):  # type: ignore[misc]
        """A run as a function of its inputs."""

        @staticmethod
        def forward(function: RunFunction, *inputs: Any) -> Any:
            return _called(function, inputs, None, lambda at, _: at.values)

        @staticmethod
        def setup_context(ctx: Any, args: Any, _: Any) -> None:
            ctx.function, *inputs = args
            ctx.known = ctx.function.last  # kept as long as the graph is
            ctx.save_for_backward(*inputs)
            ctx.save_for_forward(*inputs)

        @staticmethod
        def backward(ctx: Any, *cotangents: Any) -> Any:
            return None, *_derived(ctx, cotangents, True)

        @staticmethod
        def jvp(ctx: Any, _: Any, *directions: Any) -> Any:
            pairs = zip(ctx.saved_tensors, directions, strict=True)
            own = [torch.zeros_like(x) if d is None else d for x, d in pairs]
            return _derived(ctx, own, False)

        @staticmethod
        def vmap(info: Any, in_dims: Any, *args: Any) -> Any:
            found = Run.apply(*_batched(info, in_dims, args))
            return found, (0,) * len(found)

    return Run


@cache
def _derivative() -> Any:
    """Return the derivative of a run, or its transpose, as a linear function of PyTorch."""
    base: Any = library("torch", "lv.torch.solver").autograd.Function

    class Derivative(base):  # type: ignore[misc]
        """It takes the run's inputs, then cotangents or directions, in which it is linear."""

        @staticmethod
        def forward(function: RunFunction, known: Any, is_transposed: bool, *args: Any) -> Any:
            def call(at: RunMembers, linear: list[Any]) -> list[Any]:
                return at.pulled(linear) if is_transposed else at.pushed(linear)

            return _called(function, args, known, call)

        @staticmethod
        def setup_context(ctx: Any, args: Any, _: Any) -> None:
            ctx.function, ctx.known, ctx.is_transposed, *tensors = args
            count = len(ctx.function.inputs)
            ctx.save_for_backward(*tensors[:count])
            ctx.save_for_forward(*tensors[:count])

        @staticmethod
        def backward(ctx: Any, *cotangents: Any) -> Any:
            found = _derived(ctx, cotangents, not ctx.is_transposed)
            return (None,) * (3 + len(ctx.function.inputs)) + found

        @staticmethod
        def jvp(ctx: Any, *directions: Any) -> Any:
            linear = directions[3 + len(ctx.function.inputs) :]
            return _derived(ctx, linear, ctx.is_transposed)

        @staticmethod
        def vmap(info: Any, in_dims: Any, *args: Any) -> Any:
            found = Derivative.apply(*_batched(info, in_dims, args))
            return found, (0,) * len(found)

    return Derivative


@cache
def _held() -> Any:
    """Return the identity of PyTorch's tensors that refuses to be differentiated."""
    base: Any = library("torch", "lv.torch.solver").autograd.Function

    class Held(base):  # type: ignore[misc]
        """Inputs of a derivative, which is not differentiated by them."""

        generate_vmap_rule = True

        @staticmethod
        def forward(*inputs: Any) -> Any:
            return tuple(x.clone() for x in inputs)

        @staticmethod
        def setup_context(ctx: Any, args: Any, found: Any) -> None:
            """Keep nothing."""

        @staticmethod
        def backward(ctx: Any, *cotangents: Any) -> Any:
            raise NotImplementedError(FIRST)

        @staticmethod
        def jvp(ctx: Any, *directions: Any) -> Any:
            raise NotImplementedError(FIRST)

    return Held


def _called(function: RunFunction, tensors: Sequence[Any], known: Any, call: Call) -> Any:
    """Return tensors of what is called with runs, and of the tensors behind their inputs."""
    torch = library("torch", "lv.torch.solver")
    arrays = [x.detach().cpu().resolve_conj().resolve_neg().numpy() for x in tensors]
    found = function.mapped(arrays, call, known)
    return tuple(torch.from_numpy(np.array(x)).to(tensors[0].device) for x in found)


def _derived(ctx: Any, linear: Sequence[Any], is_transposed: bool) -> tuple[Any, ...]:
    """Return the derivative at the inputs that a context has, or its transpose."""
    inputs = _held().apply(*ctx.saved_tensors)
    how = ctx.function, ctx.known, is_transposed
    found: tuple[Any, ...] = _derivative().apply(*how, *inputs, *linear)
    return found


def _batched(info: Any, in_dims: Any, args: Sequence[Any]) -> list[Any]:
    """Return tensors with the members of a batch as their first axis; others are let be."""
    tensor = library("torch", "lv.torch.solver").Tensor
    return [
        x if not isinstance(x, tensor)
        else x.expand(info.batch_size, *x.shape) if axis is None
        else x.movedim(axis, 0)
        for x, axis in zip(args, in_dims, strict=True)
    ]  # fmt: skip
