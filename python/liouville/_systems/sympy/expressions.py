"""SymPy's expressions of mechanics as expressions that models are traced with."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from typing import Any

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted, quoted
from liouville._systems.tracing import signatures as _signatures

#: Functions of SymPy's that have a place on a tape, by the names that are printed for them.
FUNCTIONS = {
    **{name: name for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2")},
    **{name: name for name in ("sinh", "cosh", "tanh", "asinh", "acosh", "atanh")},
    **{name: name for name in ("exp", "log", "sqrt", "sign")},
    **{"Abs": "fabs", "floor": "floor", "ceiling": "ceil"},
}

#: Functions that choose, which :func:`_chosen` writes by `OPERATIONS`.
CHOICES = ("Piecewise", "Heaviside", "Mod", "Max", "Min")

#: What they are made of; conditions are numbers to CasADi.
OPERATIONS: dict[str, Callable[..., Any]] = {
    "_if_else": lambda condition, a, b: ca.if_else(ca.SX(condition), a, b),
    "_max": lambda a, b: ca.fmax(a, b),
    "_min": lambda a, b: ca.fmin(a, b),
    "_mod": lambda a, b: a - b * ca.floor(ca.SX(a) / b),
    "_and": lambda a, b: ca.logic_and(ca.SX(a), ca.SX(b)),
    "_or": lambda a, b: ca.logic_or(ca.SX(a), ca.SX(b)),
    "_not": lambda a: ca.logic_not(ca.SX(a)),
    "_less": lambda a, b: ca.SX(a) < ca.SX(b),
    "_not_more": lambda a, b: ca.SX(a) <= ca.SX(b),
    "_equal": lambda a, b: ca.SX(a) == ca.SX(b),
}

Inputs = Mapping[str, Callable[..., Any]]


def imported(name: str) -> Any:
    """Return a module of SymPy's.

    Raises
    ------
    ImportError
        SymPy is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        sentence = "models of SymPy's need sympy"
        raise ImportError(hinted(sentence, "pip install 'liouville[sympy]'")) from error


def name_of(symbol: Any) -> str:
    """Return the name of a symbol, or of a function of time."""
    return str(symbol.func.__name__) if symbol.args else str(symbol)


def compiled_of(symbols: Sequence[Any], expressions: Sequence[Any], **options: Any) -> Any:
    """Return expressions as a function that makes CasADi's of these symbols."""
    sympy = imported("sympy")
    own = {name: getattr(ca, function) for name, function in FUNCTIONS.items()}
    own |= OPERATIONS | {"abs": own["Abs"]}
    plain = [_chosen(sympy, x) for x in expressions]
    return sympy.lambdify(symbols, plain, modules=[own], **options)


def _chosen(sympy: Any, expression: Any) -> Any:
    """Write what chooses as functions: printed otherwise, it is one of Python's conditions."""

    def apply(name: str, *args: Any) -> Any:
        return sympy.Function(name)(*args)

    def all_of(name: str, args: Iterable[Any]) -> Any:
        return reduce(lambda a, b: apply(name, a, b), args)

    def condition(x: Any) -> Any:
        if x in (sympy.true, sympy.false):
            return sympy.Integer(bool(x))
        if x.is_Relational:
            a, b = x.args
            if x.rel_op in (">", ">="):
                a, b = b, a
            relation = {"==": "_equal", "!=": "_equal"}.get(x.rel_op)
            relation = relation or ("_less" if x.rel_op in ("<", ">") else "_not_more")
            return (
                apply("_not", apply(relation, a, b)) if x.rel_op == "!=" else apply(relation, a, b)
            )
        for kind, name in ((sympy.And, "_and"), (sympy.Or, "_or")):
            if isinstance(x, kind):
                return all_of(name, map(condition, x.args))
        if isinstance(x, sympy.Not):
            return apply("_not", condition(x.args[0]))
        raise ValueError(f"Piecewise has the condition {x}, which no model can have")

    def piecewise(*pairs: Any) -> Any:
        values, conditions = zip(*(x.args for x in pairs), strict=True)
        if sympy.Or(*conditions) != sympy.true:
            sentence = "a Piecewise has no value where none of its conditions holds"
            raise ValueError(hinted(sentence, "end it with (value, True)"))
        found = values[-1]
        for value, own in reversed([*zip(values, conditions, strict=True)][:-1]):
            found = apply("_if_else", condition(own), value, found)
        return found

    def heaviside(x: Any, at_zero: Any) -> Any:
        above = apply("_if_else", apply("_less", 0, x), 1, at_zero)
        return apply("_if_else", apply("_less", x, 0), 0, above)

    for kind, written in (
        (sympy.sign, sympy.Function("sign")),
        (sympy.floor, sympy.Function("floor")),
        (sympy.ceiling, sympy.Function("ceiling")),
        (sympy.Max, lambda *args: all_of("_max", args)),
        (sympy.Min, lambda *args: all_of("_min", args)),
        (sympy.Mod, lambda a, b: apply("_mod", a, b)),
        (sympy.Heaviside, heaviside),
        (sympy.Piecewise, piecewise),
    ):
        expression = expression.replace(kind, written)
    return expression


class Reader:
    """Expressions in coordinates, their rates, speeds, inputs, parameters and time.

    Attributes
    ----------
    params : dict of str to float
        Parameters with the values given.
    """

    def __init__(
        self,
        coordinates: Sequence[Any],
        speeds: Sequence[Any],
        zeros: Sequence[Any],
        given: Mapping[Any, Any] | None,
        inputs: Mapping[Any, Any] | None,
    ) -> None:
        self.sympy = imported("sympy")
        mechanics = imported("sympy.physics.mechanics")
        self.t = mechanics.dynamicsymbols._t
        self._parts = [list(coordinates), [x.diff(self.t) for x in coordinates], list(speeds)]
        dummies = {x: self.sympy.Dummy() for part in self._parts for x in part}
        self._known = dummies | dict.fromkeys(zeros, self.sympy.Integer(0))
        self._zero_rates = {x.diff(self.t): self.sympy.Integer(0) for x in zeros}
        self._inputs = {_called(x): function for x, function in (inputs or {}).items()}
        for name, function in self._inputs.items():
            state = dict.fromkeys(("t", "q", "v", "params"))
            what = f"input '{name}'"
            _signatures.check_signature(what, function, state)
            if _signatures.misnamed(function, state):
                raise _signatures.misfitting(what, function, state)
        self._dummy_inputs: dict[Any, Any] = {}
        self.params: dict[str, Any] = {_called(x): value for x, value in (given or {}).items()}
        self._seen: set[str] = set()

    def is_zero(self, expressions: Sequence[Any]) -> bool:
        """Return whether all expressions are plainly zero."""
        known = self._known | self._zero_rates
        return all(self.sympy.sympify(x).xreplace(known) == 0 for x in expressions)

    def function(self, what: str, expressions: Sequence[Any]) -> Callable[..., list[Any]]:
        """Return expressions as a function ``f(t, q, rates, u, params)`` of CasADi's.

        Raises
        ------
        TypeError, ValueError
            An expression has a function of time that is nothing known, or an operation without a
            place on a tape.
        """
        sympy = self.sympy
        plain = [sympy.sympify(x).xreplace(self._known | self._zero_rates) for x in expressions]
        used = self._check(what, plain)
        plain = [x.xreplace(self._dummy_inputs) for x in plain]
        symbols = sorted(used, key=str)
        order = [self._known[x] for part in self._parts for x in part]
        inputs = dict(self._dummy_inputs)
        args = [self.t, *order, *inputs.values(), *symbols]
        numbers = {x: sympy.Float(x.evalf(20)) for e in plain for x in e.atoms(sympy.NumberSymbol)}
        compiled = compiled_of(args, [x.xreplace(numbers) for x in plain], cse=True)

        def function(t: Any, q: Any, rates: Any, u: Any, params: Any) -> list[Any]:
            columns = [x for part in (q, rates, u) for x in ca.vertsplit(ca.SX(part))]
            columns = columns[: len(order)]
            state = (t, q, u if u.numel() else rates, params)
            acting = [self._inputs[name_of(x)](*state) for x in inputs]
            own = (getattr(params, str(x)) for x in symbols)
            return list(compiled(t, *columns, *acting, *own))

        return function

    def _check(self, what: str, expressions: Sequence[Any]) -> set[Any]:
        """Refuse what has no place on a tape; returns the parameters."""
        sympy = self.sympy
        applied = imported("sympy.core.function").AppliedUndef
        seen: set[Any] = set()
        for expression in expressions:
            for rate in expression.atoms(sympy.Derivative):
                raise ValueError(
                    hinted(
                        f"{what} has {rate}, which is no rate of a coordinate",
                        "prescribed motions are coordinates with a constraint",
                    )
                )
            for function in expression.atoms(applied):
                if name_of(function) not in self._inputs:
                    known = quoted([name_of(x) for x in self._parts[0] + self._parts[2]])
                    hint = f"give it: inputs={{'{name_of(function)}': f}}, f(t, q, v, params)"
                    sentence = f"{what} has {function}, which is none of {known}"
                    raise ValueError(hinted(sentence, hint))
                self._dummy_inputs.setdefault(function, sympy.Dummy())
            for function in expression.atoms(sympy.Function) - expression.atoms(applied):
                if type(function).__name__ not in (*FUNCTIONS, *CHOICES):
                    raise ValueError(
                        hinted(
                            f"{what} has {type(function).__name__}, which no model can have",
                            f"there are {', '.join([*FUNCTIONS, *CHOICES])}",
                        )
                    )
            seen |= expression.free_symbols - set(self._known.values()) - {self.t}
        self._seen |= {str(x) for x in seen}
        return seen

    def check_params(self) -> None:
        """Refuse parameters without a value, of all expressions that have been read."""
        missing = sorted(self._seen - self.params.keys())
        if missing:
            text = ", ".join(f"'{x}': ..." for x in missing)
            words = "parameter {} has" if len(missing) == 1 else "parameters {} have"
            sentence = f"{words.format(quoted(missing))} no value"
            raise ValueError(hinted(sentence, f"give params={{{text}}}"))


def _called(which: Any) -> str:
    return which if isinstance(which, str) else name_of(which)
