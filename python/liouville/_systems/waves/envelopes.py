r"""Drives with complex envelopes, :math:`z(t) K + \bar z(t) K^\dagger`, as pairs of real ones."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.tracing.trace import Namespace, Parameters

#: A matrix is far from Hermitian by more than this part of its largest entry, ...
FAR = 1e-5

#: ... and others are alike up to this one.
ALIKE = 1e-12

#: Envelopes are conjugates up to this part of their largest value, at so many times.
SAME, LOOKS = 1e-9, 9


class Complex:
    """A complex number of CasADi's real expressions, on which Python and NumPy calculate."""

    def __init__(self, re: Any, im: Any = 0.0) -> None:
        self.real, self.imag = ca.SX(re), ca.SX(im)

    @classmethod
    def of(cls, x: Any) -> Complex:
        """Take a number or an expression as one."""
        if isinstance(x, cls):
            return x
        is_complex = isinstance(x, complex | np.generic | np.ndarray) and np.iscomplexobj(x)
        return cls(x.real, x.imag) if is_complex else cls(x)

    def __add__(self, other: Any) -> Complex:
        own = Complex.of(other)
        return Complex(self.real + own.real, self.imag + own.imag)

    def __pos__(self) -> Complex:
        return self

    def __neg__(self) -> Complex:
        return Complex(-self.real, -self.imag)

    def __sub__(self, other: Any) -> Complex:
        return self + -Complex.of(other)

    def __rsub__(self, other: Any) -> Complex:
        return Complex.of(other) - self

    def __mul__(self, other: Any) -> Complex:
        (a, b), (c, d) = ((x.real, x.imag) for x in (self, Complex.of(other)))
        return Complex(a * c - b * d, a * d + b * c)

    def __truediv__(self, other: Any) -> Complex:
        own = Complex.of(other)
        product, square = self * own.conjugate(), own.real**2 + own.imag**2
        return Complex(product.real / square, product.imag / square)

    def __rtruediv__(self, other: Any) -> Complex:
        return Complex.of(other) / self

    def __pow__(self, power: Any) -> Complex:
        own = Complex.of(power)
        if self.imag.is_zero():
            is_real = own.imag.is_zero()
            return Complex(self.real**own.real) if is_real else (own * ca.log(self.real)).exp()
        if not (isinstance(power, int) and power > 0):
            raise TypeError("a power of a complex number that is not a positive integer")
        return reduce(Complex.__mul__, [self] * power)

    def __rpow__(self, base: Any) -> Complex:
        return Complex.of(base) ** self

    __radd__, __rmul__ = __add__, __mul__

    def __getitem__(self, index: Any) -> Complex:
        return Complex(self.real[index], self.imag[index] if self.imag.numel() > 1 else 0.0)

    def __abs__(self) -> Complex:
        return Complex(ca.sqrt(self.real**2 + self.imag**2))

    def conjugate(self) -> Complex:
        """Return the conjugate number."""
        return Complex(self.real, -self.imag)

    def exp(self) -> Complex:
        """Return its exponential."""
        size = ca.exp(self.real)
        return Complex(size * ca.cos(self.imag), size * ca.sin(self.imag))

    def __array_ufunc__(self, ufunc: Any, method: str, *args: Any, **more: Any) -> Any:
        """Apply one of NumPy's functions; of complex numbers arithmetic and exp alone."""
        if method != "__call__" or more:
            return NotImplemented
        x, *others = map(Complex.of, args)
        if ufunc in OPERATORS:
            return OPERATORS[ufunc](x, *others)
        if all(each.imag.is_zero() for each in (x, *others)):
            return Complex(ufunc(x.real, *(each.real for each in others)))
        raise TypeError(f"numpy.{ufunc.__name__} of a complex number")


OPERATORS: dict[Any, Callable[..., Any]] = {
    np.add: Complex.__add__, np.subtract: Complex.__sub__, np.multiply: Complex.__mul__,
    np.true_divide: Complex.__truediv__, np.negative: Complex.__neg__, np.exp: Complex.exp,
    np.conjugate: Complex.conjugate, np.absolute: Complex.__abs__, np.power: Complex.__pow__,
}  # fmt: skip


class Envelope:
    """The real or the imaginary part of a function of t and params with complex values."""

    def __init__(self, function: Callable[..., Any], part: str) -> None:
        self.function, self.part = function, part

    def __call__(self, t: Any, params: Any) -> ca.SX:
        """Return the part as an expression."""
        own = Namespace({name: Complex(x) for name, x in vars(params).items()})
        found = Complex.of(self.function(Complex(t), own))
        return found.real if self.part == "real" else found.imag


def taken_apart(drive: list[tuple[Any, Any]], params: Parameters) -> list[tuple[Any, Any]]:
    r"""Return a drive whose matrices are Hermitian, and whose functions or samples are real.

    A pair of functions (x, y) is an envelope z = x + i y. So are complex values with a matrix K
    that is far from Hermitian; it stands for :math:`z K + \bar z K^\dagger` where the second is
    not among the others.

    Raises
    ------
    ValueError
        What stands with :math:`K^\dagger` is not the conjugate envelope.
    """
    left, found = dict(enumerate(drive)), []
    while left:
        k = min(left)
        given, matrix = left.pop(k)
        parts = _parts(given) if _is_pair(given) or _is_far(matrix) else None
        if parts is None or not (_is_pair(given) or _is_complex(parts, params)):
            found.append((given, matrix))
            continue
        matrix = _read(matrix)
        mirrored = matrix.conj().T
        for j, (other, its) in left.items():
            if _is_far(its) and _differ(_read(its), mirrored) <= ALIKE:
                _check_conjugate(_values(parts, params), _values(_parts(other), params), (k, j))
                del left[j]
                break
        found.append((parts[0], matrix + mirrored))
        found.append((parts[1], 1j * (matrix - mirrored)))
    return found


def _is_pair(given: Any) -> bool:
    return isinstance(given, tuple | list) and len(given) == 2 and all(map(callable, given))


def _parts(given: Any) -> tuple[Any, Any] | None:
    """Return the real and the imaginary part of functions or samples."""
    if callable(given):
        return Envelope(given, "real"), Envelope(given, "imag")
    if _is_pair(given):
        return given[0], given[1]
    return (np.real(given), np.imag(given)) if np.iscomplexobj(given) else None


def _expression(parts: tuple[Any, Any], t: ca.SX, params: Parameters) -> ca.SX | None:
    """Return both parts of a function, or None where it cannot be called with complex symbols."""
    try:
        with warnings.catch_warnings():  # np.sin of symbols is theirs, whatever CasADi will do
            warnings.filterwarnings("ignore", r"\s*casadi: a numpy function", FutureWarning)
            return ca.vertcat(*(ca.SX(part(t, params.namespace)) for part in parts))
    except Exception:  # the call with real symbols says what is wrong
        return None


def _is_complex(parts: tuple[Any, Any], params: Parameters) -> bool:
    """Return whether an envelope has an imaginary part, be it zero at these parameters."""
    if not callable(parts[0]):
        return bool(parts[1].any())
    both = _expression(parts, ca.SX.sym("t"), params)
    return both is not None and both.numel() == 2 and not both[1].is_zero()


def _values(parts: tuple[Any, Any] | None, params: Parameters) -> np.ndarray | None:
    """Return values of an envelope, of a function at some times and some parameters."""
    if parts is None or not callable(parts[0]):
        return None if parts is None else parts[0] + 1j * parts[1]
    t = ca.SX.sym("t")
    both = _expression(parts, t, params)
    if both is None:
        return None
    function = ca.Function("z", [t, params.vector], [both])
    own, times = params.values(None), np.linspace(0.1, 1.7, LOOKS)
    # where a rate is zero by default, it and its negative are told apart by others
    each = [function(time, own + shift * time) for shift in (0.0, 0.1) for time in times]
    x, y = np.array(each).reshape(-1, 2).T
    return np.nan_to_num(x + 1j * y)


def _check_conjugate(
    values: np.ndarray | None, others: np.ndarray | None, places: tuple[int, int]
) -> None:
    k, j = places
    if values is not None and others is not None and values.shape == others.shape:
        off = np.abs(values - np.conj(others)).max()
        if off <= SAME * np.abs(values).max():
            return
    sentence = f"drive[{j}] is not the conjugate of drive[{k}], as H{j + 1} is of H{k + 1}"
    raise ValueError(hinted(sentence, "leave it out: z with K stands for z K + h.c."))


def _read(matrix: Any) -> Any:
    return matrix.tocsr() if hasattr(matrix, "tocsr") else np.asarray(matrix)


def _is_far(matrix: Any) -> bool:
    """Return whether a matrix is far from Hermitian."""
    array = _read(matrix)
    if array.ndim != 2 or array.shape[0] != array.shape[1] or array.dtype.kind not in "iufc":
        return False
    return _differ(array, array.conj().T) > FAR


def _differ(a: Any, b: Any) -> float:
    """Return how far matrices are apart, as a part of the largest entry."""
    if np.shape(a) != np.shape(b):
        return np.inf
    return float(abs(a - b).max()) / max(float(abs(b).max()), 1e-300)
