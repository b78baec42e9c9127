"""RK4 on any polynomial field, from its terms, compiled by Numba: the control of long runs."""

import numba
import numpy as np

FAST = {"fastmath": True, "error_model": "numpy"}


@numba.njit(**FAST)
def derivative(component, coefficient, variables, x, out):
    out[:] = 0.0
    for term in range(component.shape[0]):
        value = coefficient[term]
        for factor in range(variables.shape[1]):
            if variables[term, factor] >= 0:
                value *= x[variables[term, factor]]
        out[component[term]] += value


@numba.njit(**FAST)
def rk4(component, coefficient, variables, x, h, kept, steps):
    k, y, total = np.empty_like(x), x.copy(), np.empty_like(x)
    for row in range(1, kept.shape[0]):
        for _ in range(steps):
            total[:] = x
            y[:] = x
            for weight, ahead in ((h / 6, h / 2), (h / 3, h / 2), (h / 3, h), (h / 6, 0.0)):
                derivative(component, coefficient, variables, y, k)
                for i in range(x.shape[0]):
                    total[i] += weight * k[i]
                    y[i] = x[i] + ahead * k[i]
            x[:] = total
        kept[row] = x


def trajectory(field, start, h, records, steps):
    """Return the start and so many states, (records + 1, n), each these steps after the last."""
    terms = field.terms.to_float()
    x = np.array(start, dtype=float)
    kept = np.empty((records + 1, len(x)))
    kept[0] = x
    coefficient = terms.coefficient.astype(float)
    rk4(terms.component, coefficient, terms.variables, x, h, kept, steps)
    return kept
