"""Pullbacks of what waves record beside their states, and by the times of a run."""

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp

import liouville as lv

N = 8
RNG = np.random.default_rng(11)
TIMES = (0.5, 0.9, 1.7, 3.0)
METHOD = lv.Chebyshev(1e-12)


def matrix(is_hermitian=True):
    a = RNG.normal(size=(N, N)) + 1j * RNG.normal(size=(N, N))
    return (a + a.conj().T) / 2 if is_hermitian else a


REAL, H, B = matrix().real, matrix(), matrix()
PSI = RNG.normal(size=N) + 1j * RNG.normal(size=N)
PSI /= np.linalg.norm(PSI)

OBSERVE = {
    "diagonal": RNG.normal(size=N),
    "symmetric": sp.csr_array(matrix().real),
    "Hermitian": matrix(),
    "any": matrix(is_hermitian=False),
    "overlap": RNG.normal(size=N) + 1j * RNG.normal(size=N),
}


def driven(start=H):
    """Return a driven equation, of complex matrices unless its start is a lattice."""
    drive = [(lambda t, p: p.a * ca.sin(2 * t), B if start is H else np.diag(B).real)]
    return lv.Schrodinger(start, drive=drive, params={"a": 0.7}, hbar=0.8)


def cotangents(solution):
    """Return random cotangents of all observables, complex where these are."""
    rng, found = np.random.default_rng(3), {}
    for name in OBSERVE:
        x = solution.observed[name]
        found[name] = rng.normal(size=x.shape)
        if x.dtype.kind == "c":
            found[name] = found[name] + 1j * rng.normal(size=x.shape)
    return found


def paired(solution, given):
    return sum(np.vdot(c, solution.observed[name]).real for name, c in given.items())


@pytest.mark.parametrize("start", [H, lv.Lattice(N, periodic=True)], ids=["matrix", "lattice"])
def test_cotangents_of_observables_are_those_of_states(start):
    """By differences of whole runs, of a state and of a parameter."""
    system, run = driven(start), {"t": TIMES, "observe": OBSERVE}
    solution, pullback = lv.vjp(system, METHOD, wrt=["psi", "params.a"], psi=PSI, **run)
    given = cotangents(solution)
    found = pullback(observed=given)
    direction = RNG.normal(size=N) + 1j * RNG.normal(size=N)

    def moved(by_psi, by_a):
        psi, params = PSI + by_psi * direction, {"a": 0.7 + by_a}
        return paired(lv.integrate(system, METHOD, psi=psi, params=params, **run), given)

    d = 1e-3
    slopes = [
        sum(w * (moved(*k * s) - moved(*-k * s)) for k, w in ((1, 8), (2, -1))) / (12 * d)
        for s in d * np.eye(2)
    ]
    assert np.vdot(found["psi"], direction).real == pytest.approx(slopes[0], rel=1e-8)
    assert found["params.a"] == pytest.approx(slopes[1], rel=1e-8)
    # beside those of states, of which they are a sum
    of_states = RNG.normal(size=solution.psi.shape) + 0j
    both = pullback(psi=of_states, observed={"any": given["any"]})
    parts = pullback(psi=of_states), pullback(observed={"any": given["any"]})
    assert np.abs(both["psi"] - parts[0]["psi"] - parts[1]["psi"]).max() < 1e-12


def test_members_have_cotangents_of_their_own_observables():
    system = driven()
    run = {"t": TIMES, "observe": OBSERVE, "wrt": ["psi", "params.a"]}
    starts = np.array([PSI, PSI.conj(), np.eye(N)[2]])
    solution, pullback = lv.vjp(system, METHOD, psi=starts, **run)
    given = cotangents(solution)
    found = pullback(observed=given)
    for member, psi in enumerate(starts):
        _, alone = lv.vjp(system, METHOD, psi=psi, **run)
        own = alone(observed={name: x[:, member] for name, x in given.items()})
        assert np.array_equal(found["psi"][member], own["psi"])
        assert found["params.a"][member] == own["params.a"]


def test_cotangents_of_observables_that_do_not_fit_are_refused():
    solution, pullback = lv.vjp(driven(), METHOD, wrt=["psi"], t=TIMES, observe=OBSERVE, psi=PSI)
    assert repr(pullback).startswith("<Pullback of psi, observed.diagonal, observed.symmetric")
    with pytest.raises(TypeError, match=r"no cotangent of 'observed.energy'"):
        pullback(observed={"energy": np.ones(4)})
    with pytest.raises(TypeError, match="of observed are a mapping of their names"):
        pullback(observed=np.ones(4))
    with pytest.raises(ValueError, match=r"'observed.any' must have shape \(4,\), not \(3,\)"):
        pullback(observed={"any": np.ones(3)})
    with pytest.raises(TypeError, match="of 'diagonal' must be an array of real numbers"):
        pullback(observed={"diagonal": 1j * np.ones(4)})
    with pytest.raises(TypeError, match="observe= has cotangents of a Schrodinger equation"):
        lv.vjp(
            lv.PolynomialField(lambda t, x, p: [x[1], -x[0]], x=2),
            wrt=["x"], t=(0, 1), h=0.1, observe={}, x=[1, 0],
        )  # fmt: skip
    assert solution.observed["any"].dtype.kind == "c"


def ends(system, method, psi, times, **run):
    """Return psi at the times of a run, and its tangent by each of the times given."""
    count = len(times)
    found = lv.integrate(
        system, method, t=times, psi=psi, tangents={"t": np.eye(count), "t0": 1.0, "t1": 1.0}, **run
    )
    return found.psi, found.tangents


@pytest.mark.parametrize(
    "start", [H, REAL, lv.Grid(-6, 6, N, potential=lambda t, x, p: t * x**2 / 30)]
)
@pytest.mark.parametrize("times", [TIMES, (0.5, 3.0), (3.0, 1.0, -0.5)])
def test_derivatives_by_the_times_of_a_run_are_those_of_its_flow(start, times):
    system, psi = driven(start) if start is H else lv.Schrodinger(start), PSI
    kept, tangents = ends(system, METHOD, psi, times)
    d = 1e-3
    for k in range(len(times)):
        slope = 0
        for step, weight in ((d, 8), (2 * d, -1)):
            for sign in (1, -1):
                moved = [t + sign * step * (j == k) for j, t in enumerate(times)]
                run = lv.integrate(system, METHOD, t=moved, psi=psi)
                slope = slope + sign * weight * run.psi / (12 * d)
        assert np.abs(tangents["t"].psi[:, k] - slope).max() < 1e-8
        # a time in between moves its own state alone
        assert k in (0, len(times) - 1) or np.abs(slope[[0, -1]]).max() < 1e-8
    assert np.array_equal(tangents["t0"].psi, tangents["t"].psi[:, 0])
    assert np.array_equal(tangents["t1"].psi, tangents["t"].psi[:, -1])
    assert np.abs(kept).max() > 0.1


@pytest.mark.parametrize(
    ("method", "run"),
    [
        ("auto", {"t": TIMES}),
        (lv.Magnus(4), {"t": (0.5, 3.0), "steps": 100, "every": 30}),
    ],
)
def test_tangents_pullbacks_and_runs_moved_agree_on_the_times(method, run):
    found = lv.analysis.check_gradient(
        driven(), method, wrt=["psi", "t0", "t1", "t", "params.a"], psi=PSI, size=1e-3, **run
    )
    assert found.dot < 1e-13
    assert found.differences < 1e-8


def test_the_gradient_by_the_end_of_a_flip_is_zero_where_it_is_done():
    """P = sin^2 t of a qubit: the gradient by the end is sin 2t, by the start its negative."""
    qubit = lv.Schrodinger([[0, 1], [1, 0]])
    for t in (0.3, np.pi / 2):
        run = {"t": (0.1, 0.1 + t), "psi": [1, 0], "observe": {"P": [0.0, 1.0]}}
        solution, pullback = lv.vjp(qubit, METHOD, wrt=["t0", "t1", "t"], **run)
        found = pullback(observed={"P": [0, 1]})
        assert found["t1"] == pytest.approx(np.sin(2 * t), abs=1e-11)
        assert found["t0"] == pytest.approx(-np.sin(2 * t), abs=1e-11)
        assert found["t"] == pytest.approx([found["t0"], found["t1"]])
        assert pullback(observed={"P": [0, 0]})["t"] == pytest.approx([0, 0])
        # of the start alone nothing moves
        assert pullback(observed={"P": [1, 0]})["t"] == pytest.approx([0, 0], abs=1e-15)
        assert solution.observed["P"][-1] == pytest.approx(np.sin(t) ** 2, abs=1e-11)
