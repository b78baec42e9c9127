"""Operators, states and drives as QuTiP and QuSpin have them, and drives as samples."""

import pickle

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp

import liouville as lv

SX, SZ = np.array([[0.0, 1.0], [1.0, 0.0]]), np.diag([1.0, -1.0])
TIMES = np.linspace(0.0, 3.0, 301)


class Sparse:
    def __init__(self, matrix):
        self.matrix = sp.csr_array(matrix, dtype=complex)

    def as_scipy(self):
        return self.matrix


class Qobj:
    """What is looked at of a Qobj: it is read by what it has, not by what it is."""

    def __init__(self, array, kind="oper", is_sparse=True):
        self.array = np.asarray(array, dtype=complex)
        self.type, self.isket, self.dims = kind, kind == "ket", [[2], [2]]
        self.data = Sparse(self.array) if is_sparse else object()

    def full(self):
        return self.array


class QuSpin:
    def __init__(self, static, dynamic):
        self.static, self.dynamic = sp.csr_matrix(static), dynamic


def ends(system, psi, params=None, **more):
    method = lv.Chebyshev(tol=1e-9)
    return lv.integrate(system, method, t=(0, 3), psi=psi, params=params, **more)


PLAIN = lv.Schrodinger(SZ, drive=[(lambda t, params: np.sin(params.w * t), SX)], params={"w": 1.3})
START = np.array([1.0, 0.0])


@pytest.mark.parametrize("is_sparse", [True, False])
@pytest.mark.parametrize(
    "function",
    [lambda t, params: np.sin(params.w * t), lambda t, args: np.sin(args["w"] * t),
     lambda t, w: np.sin(w * t), lambda t: np.sin(1.3 * t)],
)  # fmt: skip
def test_a_list_of_operators_and_functions_is_the_drive_that_it_says(function, is_sparse):
    h0, h1 = Qobj(SZ, is_sparse=is_sparse), Qobj(SX, is_sparse=is_sparse)
    system = lv.Schrodinger([h0, [h1, function]], params={"w": 1.3})
    ket = Qobj(START[:, None], "ket")
    found = ends(system, ket, observe={"x": h1, "own": Qobj(START[:, None], "ket")})
    assert found.psi.tolist() == ends(PLAIN, START).psi.tolist()
    assert found.observed["own"][-1] == found.psi[-1, 0]
    again = pickle.loads(pickle.dumps(system.with_params({"w": 1.3})))
    assert ends(again, START).psi.tolist() == found.psi.tolist()


def test_matrices_in_lists_and_operators_of_quspin_are_taken():
    both = lv.Schrodinger([SZ, 0.5 * SX, [SX, lambda t: t]])
    one = lv.Schrodinger(SZ + 0.5 * SX, drive=[(lambda t, params: t, SX)])
    assert ends(both, START).psi.tolist() == ends(one, START[:, None]).psi.tolist()
    alone = lv.Schrodinger([[SX, lambda t: t]])
    assert alone.bounds[0] == pytest.approx(0.0, abs=1e-12)
    assert lv.Schrodinger(QuSpin(SX, {})).bounds == lv.Schrodinger(SX).bounds
    assert lv.Schrodinger([[0.0, 1.0], [1.0, 0.0]]).bounds == lv.Schrodinger(SX).bounds


def test_kets_of_an_ensemble_are_its_members():
    kets = [Qobj([[1], [0]], "ket"), Qobj([[0], [1]], "ket")]
    found = lv.ensemble(lv.Schrodinger(Qobj(SX)), "auto", t=(0, 1), psi=kets)
    assert (
        abs(found.psi[-1] - [[np.cos(1), -1j * np.sin(1)], [-1j * np.sin(1), np.cos(1)]]).max()
        < 1e-7
    )


def test_samples_stand_for_their_spline():
    values = np.sin(1.3 * TIMES)
    by_list = lv.Schrodinger([SZ, [SX, values]], times=TIMES)
    by_drive = lv.Schrodinger(SZ, drive=[(values.tolist(), SX)], times=TIMES)
    exact = ends(PLAIN, START).psi[-1]
    found = ends(by_list, START).psi[-1]
    assert found.tolist() == ends(by_drive, START).psi[-1].tolist()
    assert 1e-13 < np.linalg.norm(found - exact) < 1e-8  # of the order of their distance ** 4
    other = pickle.loads(pickle.dumps(by_list))
    assert ends(other, START).psi[-1].tolist() == found.tolist()
    with pytest.raises(ValueError, match="leaves the samples"):
        lv.integrate(other, "auto", t=(0.0, 4.0), psi=START)


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: lv.Schrodinger([SZ, [SX, TIMES]]), TypeError, "their times are not given"),
        (lambda: lv.Schrodinger([SZ, [SX, TIMES[1:]]], times=TIMES), ValueError,
         r"drive\[0\] has samples of shape \(300,\), and there are 301 times"),
        (lambda: lv.Schrodinger([SZ, [SX, 1j * TIMES]], times=TIMES), ValueError,
         r"the samples of drive\[0\] are complex\nhint: z K"),
        (lambda: lv.Schrodinger([SZ, [SX, np.r_[TIMES[:-1], np.nan]]], times=TIMES), ValueError,
         r"sample 300 of drive\[0\], at t = 3, must be a finite number, not nan"),
        (lambda: lv.Schrodinger([SZ, [SX, TIMES], [SZ, ["1"] * 301]], times=TIMES), TypeError,
         r"the function of drive\[1\]"),
        (lambda: lv.Schrodinger([SZ, [SX, TIMES]], times=np.r_[TIMES[:-1], 2.0]), ValueError,
         r"times must increase: times\[299\] = 2.99 is followed by 2\nhint: sort times and"),
        (lambda: lv.Schrodinger([SZ, [SX, TIMES]], times=np.r_[np.inf, TIMES[1:]]), ValueError,
         r"times\[0\] must be a finite number, not inf"),
        (lambda: lv.Schrodinger([SZ, [SX, [1.0]]], times=[0.0]), ValueError, "times must be 2 at"),
        (lambda: ends(lv.Schrodinger([SZ, [SX, TIMES[:99]]], times=TIMES[:99]), START), ValueError,
         r"leaves the samples of drive\[0\], which are from 0 to \d.*\nhint: .* zeros after"),
        (lambda: lv.analysis.ground_state(lv.Schrodinger([SZ, [SX, TIMES]], times=TIMES), t=99.0),
         ValueError, r"t = 99 leaves the samples of drive\[0\]"),
        (lambda: lv.Schrodinger([SZ, [np.cos, SX]]), TypeError, r"and pairs \[H1, f\], not"),
        (lambda: lv.Schrodinger([SZ, [SX, "sin(t)"]]), TypeError, r"drive\[0\] is the text"),
        (lambda: lv.Schrodinger(QuSpin(SX, {"f": SZ})), TypeError, "1 parts that depend on time"),
        (lambda: lv.Schrodinger(Qobj(np.eye(4), "super")), TypeError,
         "H is a Qobj of type 'super'"),
        (lambda: ends(lv.Schrodinger(SX), Qobj(np.eye(2))), TypeError, "must be a ket, not a Qobj"),
        (lambda: lv.Schrodinger(SX, drive=[(None,)]), TypeError, "a pair of a function and a mat"),
    ],
)  # fmt: skip
def test_what_is_not_taken_is_said(make, error, words):
    with pytest.raises(error, match=words):
        make()


def test_a_name_with_a_default_is_a_parameter_or_keeps_it():
    """As functions made in a loop have them."""
    z, x = np.diag([1.0, -1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])
    run = {"t": (0, 2), "psi": [1.0, 0.0]}

    def end(function, params=None):
        system = lv.Schrodinger([z, [x, function]], params=params)
        return lv.integrate(system, "auto", **run).psi[-1]

    wanted = end(lambda t: 0.5 * ca.cos(3.0 * t))
    kept = end(lambda t, w, a=0.5: a * ca.cos(w * t), {"w": 3.0})
    given = end(lambda t, a=0.1, w=9.0: a * ca.cos(w * t), {"w": 3.0, "a": 0.5})
    np.testing.assert_allclose([kept, given], [wanted, wanted], rtol=0, atol=1e-12)
    with pytest.raises(AttributeError, match="there is no parameter 'w'"):
        end(lambda t, w, a=0.5: a * ca.cos(w * t))


def test_qutip_and_this_library_agree():
    qutip = pytest.importorskip("qutip")
    h0 = qutip.tensor(qutip.sigmaz(), qutip.qeye(3)) + qutip.tensor(qutip.sigmax(), qutip.num(3))
    h1 = qutip.tensor(qutip.sigmax(), qutip.create(3) + qutip.destroy(3))
    psi = qutip.tensor(qutip.basis(2, 0), qutip.basis(3, 1))
    pulse = np.exp(-((TIMES - 1.5) ** 2))
    system = lv.Schrodinger([h0, [h1, pulse]], times=TIMES)
    found = ends(system, psi, observe={"n": qutip.tensor(qutip.qeye(2), qutip.num(3))})
    options = {"atol": 1e-12, "rtol": 1e-11, "nsteps": 10**6}
    driven = qutip.QobjEvo([h0, [h1, pulse]], tlist=TIMES)
    theirs = qutip.sesolve(driven, psi, [0, 3], options=options).states[-1]
    assert np.linalg.norm(found.psi[-1] - theirs.full().ravel()) < 1e-8
    number = qutip.expect(qutip.tensor(qutip.qeye(2), qutip.num(3)), theirs)
    assert found.observed["n"][-1] == pytest.approx(number, abs=1e-8)
    with pytest.raises(TypeError, match="H is a QobjEvo, whose functions are compiled"):
        lv.Schrodinger(driven)
