"""Few levels over long times: "auto" takes the eigenvectors of H."""

import mpmath as mp
import numpy as np
import pytest

import liouville as lv

LONG = 1e4


def hermitian(n, is_real, seed=0):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n)) + (0 if is_real else 1j) * rng.normal(size=(n, n))
    return (a + a.conj().T) / 2


def start(n, seed=1):
    rng = np.random.default_rng(seed)
    psi = rng.normal(size=n) + 1j * rng.normal(size=n)
    return psi / np.linalg.norm(psi)


def exact(h, psi, t):
    """Return psi at a time, in forty digits."""
    with mp.workdps(40):
        energies, modes = mp.eigh(mp.matrix(h.tolist()))
        inward = modes.H * mp.matrix(psi.tolist())
        turned = mp.matrix([mp.expj(-e * t) * c for e, c in zip(energies, inward, strict=True)])
        return np.array([complex(z) for z in modes * turned])


@pytest.mark.parametrize("is_real", [True, False])
@pytest.mark.parametrize("end", [LONG, -LONG])
def test_the_error_is_within_the_bound(is_real, end):
    h, psi = hermitian(6, is_real), start(6)
    run = lv.integrate(lv.Schrodinger(h), "auto", t=(0, end), psi=psi)
    assert run.stats["products"] == 2
    error = np.linalg.norm(run.psi[-1] - exact(h, psi, end))
    assert error <= run.stats["bound"] <= 1e-8


def test_all_outputs_and_members_are_within_the_bound():
    h = hermitian(5, is_real=False)
    system, starts = lv.Schrodinger(h), np.array([start(5, 2), start(5, 3)])
    t = np.linspace(0, LONG, 21)
    found = lv.ensemble(system, "auto", t=t, psi=starts)
    for member, psi in enumerate(starts):
        for k in (1, 10, 20):
            error = np.linalg.norm(found.psi[k, member] - exact(h, psi, t[k]))
            assert error <= found.stats["bound"]


def test_degenerate_levels_and_one_level_are_no_exception():
    run = lv.integrate(lv.Schrodinger(np.diag([2.0, 2.0, 2.0, 5.0])), t=(0, LONG), psi=start(4))
    want = np.exp(-1j * LONG * np.array([2.0, 2.0, 2.0, 5.0])) * start(4)
    assert np.linalg.norm(run.psi[-1] - want) <= run.stats["bound"]


def test_a_constant_drive_is_a_part_of_h():
    h, x = hermitian(4, is_real=True), np.diag([0.0, 1.0, 2.0, 3.0])
    drive = [(lambda t, params: params.a, x)]
    system = lv.Schrodinger(h, drive=drive, params={"a": 0.5})
    run = lv.integrate(system, "auto", t=(0, LONG), psi=start(4))
    assert "eigenvectors" in str(lv.plan(system, t=(0, LONG)))
    assert np.linalg.norm(run.psi[-1] - exact(h + 0.5 * x, start(4), LONG)) <= 1e-8


def test_short_runs_and_other_methods_are_as_before():
    system = lv.Schrodinger(hermitian(6, is_real=True))
    assert "eigenvectors" not in str(lv.plan(system, t=(0, 10)))
    assert "eigenvectors" not in str(lv.plan(system, lv.Chebyshev(), t=(0, LONG)))
    assert "products with H" in str(lv.plan(system, t=(0, LONG)))


def test_a_plan_comes_back_from_its_file_and_a_derivative_takes_another(tmp_path):
    system, psi = lv.Schrodinger(hermitian(6, is_real=True)), start(6)
    plan = lv.plan(system, t=(0, LONG))
    plan.save(tmp_path / "plan.json")
    read = lv.Plan.load(tmp_path / "plan.json")
    first = lv.integrate(system, plan, t=(0, LONG), psi=psi)
    assert np.array_equal(first.psi, lv.integrate(system, read, t=(0, LONG), psi=psi).psi)
    moved = lv.integrate(system, plan, t=(0, LONG), psi=psi, tangents={"psi": psi})
    assert np.linalg.norm(moved.tangents["psi"].psi[-1] - first.psi[-1]) < 1e-7
