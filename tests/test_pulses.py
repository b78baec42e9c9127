"""Pulses much shorter than a run, at places that nobody names, by all methods that choose steps."""

import casadi as ca
import numpy as np
import pytest
from ordinary import propagated

import liouville as lv

PARTS = (1e-1, 1e-2, 1e-3, 1e-4)
FLIP = np.array([[0.0, 1.0], [1.0, 0.0]])


def pulse(t, at, width, area, exp=ca.exp):
    return area / (width * np.sqrt(np.pi)) * exp(-(((t - at) / width) ** 2))


def places(part, span):
    """Return a width and places that are those of no grid."""
    rng = np.random.default_rng(round(1 / part))
    return part * span, rng.uniform(0.02 * span, 0.98 * span, 3)


def flipped(at, width, area, end):
    """Return the state of a qubit after a pulse, in steps far below its width."""
    low, high = max(0.0, at - 8 * width), min(end, at + 8 * width)

    def product(t, y):
        f = pulse(t, at, width, area, np.exp)
        return np.array([f * y[1], y[1] + f * y[0]])

    found = propagated(product, np.linspace(low, high, 49), [1.0, 0.0])[-1]
    return found * np.exp(-1j * np.array([0.0, 1.0]) * (end - high))


@pytest.mark.parametrize("part", PARTS)
def test_a_pulse_on_a_qubit_is_seen_by_every_method(part):
    end = 10.0
    width, times = places(part, end)
    methods = [lv.SchrodingerSplitting(), lv.Chebyshev(1e-4), lv.Magnus(2, 1e-3)]
    methods += [lv.Magnus(order, 10.0**-order) for order in (4, 6, 8)]
    for at, area in zip(times, (3.0, 0.3, 0.01), strict=True):
        drive = [(lambda t, _, at=at, area=area: pulse(t, at, width, area), FLIP)]
        system = lv.Schrodinger(np.diag([0.0, 1.0]), drive=drive)
        want = flipped(at, width, area, end)
        for method in methods:
            run = lv.integrate(system, method, t=(0, end), psi=[1, 0])
            assert np.linalg.norm(run.psi[-1] - want) <= method.tol, (method, at)


def gaussian(x, centre, speed=0.0):
    psi = np.exp(-((x - centre) ** 2) / 2 + 1j * speed * x)
    return psi / np.linalg.norm(psi)


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("is_drive", [False, True])
def test_a_pulse_on_an_oscillator_is_seen_by_every_method(part, is_drive):
    # a coherent state follows the classical path, up to a phase
    end = 4.0
    width, times = places(part, end)
    for at, area in zip(times, (3.0, 0.3, 0.01), strict=True):
        own = lv.Grid(
            -10, 10, 128,
            potential=lambda t, x, _, at=at, area=area: (
                x**2 / 2 - (0.0 if is_drive else pulse(t, at, width, area) * x)
            ),
        )  # fmt: skip
        x = own.points[:, 0]
        drive = [(lambda t, _, at=at, area=area: pulse(t, at, width, area), -x)] if is_drive else []
        system, psi = lv.Schrodinger(own, drive=drive), gaussian(x, 1.0)
        s, w = np.polynomial.legendre.leggauss(200)
        low, high = max(0.0, at - 8 * width), min(end, at + 8 * width)
        s = 0.5 * (low + high) + 0.5 * (high - low) * s
        w = 0.5 * (high - low) * w * pulse(s, at, width, area, np.exp)
        centre = np.cos(end) + w @ np.sin(end - s)
        speed = -np.sin(end) + w @ np.cos(end - s)
        for tol in (1e-2, 1e-4, 1e-8):
            for method in (lv.SplitOperator(tol=tol), lv.Chebyshev(tol)):
                run = lv.integrate(system, method, t=(0, end), psi=psi)
                last = run.psi[-1]
                overlap = abs(np.vdot(gaussian(x, centre, speed), last))
                apart = 1 + np.linalg.norm(last) ** 2 - 2 * overlap
                assert apart <= tol**2 + 1e-13, (method, at)


def stepped(own, value, psi, end, steps):
    """Return the state by Strang's steps of so many and of half of them, extrapolated."""
    x, (k,) = own.points[:, 0], own.k
    found = []
    for count in (steps // 2, steps):
        h, state = end / count, np.fft.fft(psi)
        half = np.exp(-0.25j * h * k**2)
        for j in range(count):
            state = np.fft.ifft(half * state)
            state *= np.exp(-1j * h * value((j + 0.5) * h, x, np))
            state = half * np.fft.fft(state)
        found.append(np.fft.ifft(state))
    return (4 * found[1] - found[0]) / 3


def bump(x, m):
    return m.exp(-((x - 1.1) ** 2) / 0.02)


#: Potentials that change at few points of a grid: with a function of time as a factor, with time
#: and place in one function, and where they move.
LOCAL = {
    "factor": lambda t, x, m: x**2 / 2 + pulse(t, 1.7, 0.1, 2.0, m.exp) * bump(x, m),
    "mixed": lambda t, x, m: (
        x**2 / 2 + 20 * m.exp(-(((t - 0.7) / 0.05) ** 2) - (x - 1.1) ** 2 / 0.02)
    ),
    "moving": lambda t, x, m: x**2 / 2 - 5 * m.exp(-((x + 6.03 - 5 * t) ** 2) / 0.03),
}


@pytest.mark.parametrize("name", LOCAL)
def test_a_potential_that_changes_at_few_points_is_seen(name):
    end, value = 2.5, LOCAL[name]
    own = lv.Grid(-10, 10, 512, potential=lambda t, x, _: value(t, x, ca))
    psi = gaussian(own.points[:, 0], 1.0)
    want = stepped(own, value, psi, end, 3000)
    methods = (lv.Chebyshev(1e-4), lv.Magnus(4, 1e-4), lv.SplitOperator(tol=1e-4))
    for method in (*methods, lv.SplitOperator(tol=1e-6), lv.Chebyshev(1e-6)):
        run = lv.integrate(lv.Schrodinger(own), method, t=(0, end), psi=psi)
        assert np.linalg.norm(run.psi[-1] - want) <= method.tol, method


def test_a_pulse_of_a_nonlinearity_is_seen():
    end, at, width = 2.0, 1.2345, 1e-3
    own = lv.Grid(-10, 10, 128, potential=lambda t, x, _: x**2 / 2)
    psi = gaussian(own.points[:, 0], 1.0)

    def strength(t, rho, _):
        return pulse(t, at, width, 3.0) * rho

    system = lv.Schrodinger(own, nonlinearity=strength)
    named = lv.Schrodinger(own, nonlinearity=strength, points=[at - 3 * width, at, at + 3 * width])
    want = lv.integrate(named, lv.SplitOperator(tol=1e-9), t=(0, end), psi=psi).psi[-1]
    calm = lv.integrate(lv.Schrodinger(own), t=(0, end), psi=psi).psi[-1]
    assert np.linalg.norm(want - calm) > 0.1
    for tol in (1e-2, 1e-4, 1e-6):
        run = lv.integrate(system, lv.SplitOperator(tol=tol), t=(0, end), psi=psi)
        assert np.linalg.norm(run.psi[-1] - want) <= tol


def test_functions_of_many_parts_and_of_two_axes_are_those_that_were_given():
    def value(t, x, params):
        found = params.a * ca.sin(x[0] + t) * ca.exp(-(x[1] ** 2) / (2 + ca.cos(t)))
        return found + sum(ca.cos(k * t) * ca.sin(k * x[0] + x[1]) / k for k in range(1, 12))

    def few(t, x, params):
        return params.a * x[0] * ca.cos(3 * t) * x[1] * ca.exp(-t) + x[0] ** 2 / 2

    # without kinetic energy each point has a phase, the integral of the potential there
    nodes, weights = np.polynomial.legendre.leggauss(24)
    for function in (value, few):
        own = lv.Grid((-3, -3), (3, 3), (8, 12), potential=function, mass=1e16)
        system = lv.Schrodinger(own, params={"a": 0.7}).with_params({"a": 0.3})
        psi = np.exp(-(own.points**2).sum(axis=1)) + 0.1j * own.points[:, 0]
        psi /= np.linalg.norm(psi)
        each = zip(0.5 + 0.5 * nodes, 0.5 * weights, strict=True)
        want = psi * np.exp(-1j * sum(w * system.potential_at(t) for t, w in each))
        for method in ("auto", lv.SplitOperator(tol=1e-9)):
            run = lv.integrate(system, method, t=(0, 1), psi=psi)
            assert np.linalg.norm(run.psi[-1] - want) <= 1e-8
