"""A step of the classical Runge-Kutta method in three variables, compiled by Numba."""

import numba

FAST = {"fastmath": True, "error_model": "numpy"}
BLOCK = 512  # tracers that a vectorised loop takes through all steps together


def stepper(field):
    """Return a step of a compiled field, to be inlined where it is called."""

    @numba.njit(inline="always", **FAST)
    def rk4_step(x, y, z, h):
        a1, b1, c1 = field(x, y, z)
        a2, b2, c2 = field(x + h / 2 * a1, y + h / 2 * b1, z + h / 2 * c1)
        a3, b3, c3 = field(x + h / 2 * a2, y + h / 2 * b2, z + h / 2 * c2)
        a4, b4, c4 = field(x + h * a3, y + h * b3, z + h * c3)
        x += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        y += h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
        z += h / 6 * (c1 + 2 * c2 + 2 * c3 + c4)
        return x, y, z

    return rk4_step
