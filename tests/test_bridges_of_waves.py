"""Bridges of wave functions, of fields and of members: each library's own checks pass."""

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from test_index2_gradients import started

import liouville as lv
from liouville._bridges import run
from liouville.problems import abc_flow

RNG = np.random.default_rng(4)
N = 5
H, B, C = (x + x.T for x in RNG.standard_normal((3, N, N)))
C = C + 1j * np.triu(C, 1) - 1j * np.triu(C, 1).T
U = RNG.standard_normal(7)
PSI = RNG.standard_normal(N) + 1j * RNG.standard_normal(N)
TARGET = RNG.standard_normal(N) + 1j * RNG.standard_normal(N)
A, TIMES = np.array(0.6), (0.0, 0.7, 2.0)
WRT = ("psi", "params.a", "drive[1]")
SYSTEM = lv.Schrodinger(
    H,
    drive=[(lambda t, p: p.a * ca.sin(2 * t), B), (U, C)],
    times=np.linspace(0, 2, U.size),
    params={"a": 0.6},
)
METHOD = lv.Chebyshev(1e-13)
FLOW = {"t": (0, 1.0), "steps": 10, "every": 5}


def expected():
    """Return the gradients of the normalised fidelity at the end, by `vjp`."""
    solution, pullback = lv.vjp(SYSTEM, METHOD, wrt=WRT, t=TIMES, psi=PSI)
    end, cotangent = solution.psi[-1], np.zeros_like(solution.psi)
    overlap, norm = np.vdot(TARGET, end), np.vdot(end, end).real
    cotangent[-1] = 2 * overlap * TARGET / norm - 2 * abs(overlap) ** 2 * end / norm**2
    return abs(overlap) ** 2 / norm, [*pullback(psi=cotangent).values()]


def fidelity(psi, like):
    end = psi[-1]
    overlap = (end * np.conj(TARGET)).sum()
    return like.abs(overlap) ** 2 / (like.abs(end) ** 2).sum()


def test_jax_differentiates_wave_functions_by_its_own_convention(jax):
    """Its gradient by a complex number is the conjugate of ours."""
    from jax.test_util import check_grads

    solve = lv.jax.solver(SYSTEM, METHOD, wrt=WRT, t=TIMES)

    def value(*inputs):
        return fidelity(solve(*inputs), jax.numpy)

    fid, (by_psi, *others) = expected()
    found, slopes = jax.jit(jax.value_and_grad(value, (0, 1, 2)))(PSI, A, U)
    assert found == pytest.approx(fid, rel=1e-14)
    for own, wanted in zip(slopes, [np.conj(by_psi), *others], strict=True):
        np.testing.assert_allclose(own, wanted, rtol=1e-11, atol=1e-13)
    check_grads(value, (PSI, A, U), 1, modes=["fwd", "rev"], atol=1e-7, rtol=1e-7)
    # and the states themselves, whose cotangents are complex
    check_grads(solve, (PSI, A, U), 1, modes=["fwd", "rev"], atol=1e-7, rtol=1e-7)


@pytest.mark.filterwarnings("ignore:.torch.jit.script")  # PyTorch's own, in forward mode
def test_torch_differentiates_wave_functions_by_its_own_convention(torch):
    """Its gradient by a complex number is ours."""
    solve = lv.torch.solver(SYSTEM, METHOD, wrt=WRT, t=TIMES)
    inputs = [torch.tensor(x, requires_grad=True) for x in (PSI, A, U)]
    fid, wanted = expected()
    target = torch.tensor(TARGET)

    def value(*inputs):
        end = solve(*inputs)[-1]
        return torch.vdot(target, end).abs() ** 2 / torch.vdot(end, end).real

    found = value(*inputs)
    found.backward()
    assert found.item() == pytest.approx(fid, rel=1e-14)
    for x, own in zip(inputs, wanted, strict=True):
        np.testing.assert_allclose(x.grad.numpy(), own, rtol=1e-11, atol=1e-13)
    assert torch.autograd.gradcheck(solve, inputs, check_forward_ad=True)
    assert torch.autograd.gradcheck(value, inputs)


def test_casadi_has_real_and_imaginary_parts():
    solve = lv.casadi.solver(SYSTEM, METHOD, wrt=WRT, t=TIMES)
    assert solve.name_in() == ["psi_re", "psi_im", "params_a", "drive_1"]
    assert solve.name_out() == ["psi_re", "psi_im"]
    symbols = [ca.MX.sym("x", *np.shape(x)) for x in (PSI, PSI, A, U)]
    re, im = (x[-1, :].T for x in solve(*symbols))
    across = ca.dot(re, TARGET.real) + ca.dot(im, TARGET.imag)
    turned = ca.dot(im, TARGET.real) - ca.dot(re, TARGET.imag)
    value = (across**2 + turned**2) / (ca.sumsqr(re) + ca.sumsqr(im))
    fid, (by_psi, *others) = expected()
    gradients = [ca.gradient(value, x) for x in symbols]
    along = [RNG.standard_normal(np.shape(x)) for x in (PSI, PSI, A, U)]
    forward = sum(ca.jtimes(value, x, d) for x, d in zip(symbols, along, strict=True))
    function = ca.Function("all", symbols, [value, forward, *gradients])
    found, pushed, *slopes = (x.full().ravel() for x in function(PSI.real, PSI.imag, A, U))
    assert found[0] == pytest.approx(fid, rel=1e-14)
    for own, wanted in zip(slopes, [by_psi.real, by_psi.imag, *others], strict=True):
        np.testing.assert_allclose(own, np.ravel(wanted), rtol=1e-11, atol=1e-13)
    paired = sum(np.sum(x * np.ravel(d)) for x, d in zip(slopes, along, strict=True))
    assert pushed[0] == pytest.approx(paired, rel=1e-10)


def test_ipopt_finds_a_pulse():
    """A spin is turned over with the least energy by a pulse of constant height."""
    spin = lv.Schrodinger(
        np.zeros((2, 2)), drive=[(np.ones(11), [[0, 1], [1, 0]])], times=np.linspace(0, 1, 11)
    )
    solve = lv.casadi.solver(spin, "auto", wrt=["drive[0]"], t=(0, 1), psi=[1, 0])
    with pytest.raises(RuntimeError, match=r"'drive\[0\]' must be finite"):
        solve(np.full(11, np.nan))
    u = ca.MX.sym("u", 11)
    re, im = (x[-1, :] for x in solve(u))
    turned = (re[1] ** 2 + im[1] ** 2) / (ca.sumsqr(re) + ca.sumsqr(im))
    nodes, weights = np.polynomial.legendre.leggauss(4)
    at = (np.arange(10)[:, None] + (nodes + 1) / 2).ravel() / 10
    splines = CubicSpline(spin.sensitivity.times("drive[0]"), np.eye(11))(at)
    energy = splines.T @ (np.tile(weights / 20, 10)[:, None] * splines)  # of the pulse
    problem = {"x": u, "f": ca.bilin(ca.DM(energy), u, u), "g": turned}
    options = {"ipopt.hessian_approximation": "limited-memory", "ipopt.print_level": 0}
    options |= {"ipopt.sb": "yes", "print_time": False, "ipopt.tol": 1e-7}
    optimum = ca.nlpsol("turn", "ipopt", problem, options)
    found = optimum(x0=np.linspace(0.8, 1.2, 11), lbg=0.999, lbx=-4, ubx=4)
    assert optimum.stats()["return_status"] == "Solve_Succeeded"
    angle = np.arcsin(np.sqrt(0.999))
    np.testing.assert_allclose(found["x"].full().ravel(), angle, rtol=1e-3)
    assert float(found["f"]) == pytest.approx(angle**2, rel=1e-5)


def test_steps_of_a_method_and_a_start_that_is_held():
    """Of Magnus' method, with what a run keeps, and a parameter that is no input."""
    solve = lv.casadi.solver(
        SYSTEM, lv.Magnus(4), wrt=["drive[1]"], t=(0, 2), steps=20, every=8, psi=PSI,
        params={"a": 0.3},
    )  # fmt: skip
    u = 0.5 * U
    other = lv.Schrodinger(
        H, drive=[(lambda t, p: 0.3 * ca.sin(2 * t), B), (u, C)], times=np.linspace(0, 2, U.size)
    )
    wanted = lv.integrate(other, lv.Magnus(4), t=(0, 2), steps=20, every=8, psi=PSI).psi
    re, im = (x.full() for x in solve(u))
    np.testing.assert_allclose(re + 1j * im, wanted, atol=1e-13)


def test_fields_in_all_three(jax, torch):
    wrt, x, a = ["x", "params.A", "t1"], np.array([0.1, 0.2, 0.3]), 1.1
    method = lv.VolumeSplitting(composition="BM4")
    one, pullback = lv.vjp(
        abc_flow.system, method, wrt=wrt, t=(0, 0.9), steps=10, every=5, x=x, params={"A": a}
    )
    cotangent = np.zeros_like(one.x)
    cotangent[-1, 2] = 1
    wanted = [*pullback(x=cotangent).values()]
    own = {"wrt": wrt, **FLOW}
    solve = lv.jax.solver(abc_flow.system, method, **own)
    found = jax.grad(lambda *args: solve(*args)[-1, 2], (0, 1, 2))(x, a, 0.9)
    tensors = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (x, a, 0.9)]
    lv.torch.solver(abc_flow.system, method, **own)(*tensors)[-1, 2].backward()
    symbols = [ca.MX.sym("x", *np.shape(v)) for v in (x, a, 0.9)]
    call = lv.casadi.solver(abc_flow.system, method, **own)
    slopes = [ca.gradient(call(*symbols)[-1, 2], s) for s in symbols]
    function = ca.Function("slopes", symbols, slopes)
    own = [v.full() for v in function(x, a, 0.9)]
    for values in (found, [v.grad.numpy() for v in tensors], own):
        for value, want in zip(values, wanted, strict=True):
            np.testing.assert_array_equal(np.ravel(value), np.ravel(want))


def test_semi_explicit_systems_from_starts_beside_their_constraints(jax, monkeypatch):
    """Derivatives of the start moved, by CasADi both ways and by JAX of members."""
    system, start, _ = started()
    call = {"wrt": ["y", "params.l", "t0"], "t": (0.2, 0.5), "steps": 4, "every": 4}
    point = [1.02 * start["y"], np.array(1.1), np.array(0.2)]
    solve = lv.casadi.solver(system, lv.Spark(2), returns=("y", "z"), **call)
    along = [RNG.standard_normal(np.shape(x)) for x in point]
    values = {}
    for m in (1, -1, 2, -2, 3, -3):
        moved = [x + m * 2e-3 * d for x, d in zip(point, along, strict=True)]
        values[m] = np.concatenate([x.full().ravel() for x in solve(*moved)])
    weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    slope = sum(w / 2e-3 * (values[m] - values[-m]) for m, w in weights.items())
    symbols = [ca.MX.sym("x", *np.shape(x)) for x in point]
    outputs = ca.vertcat(*(ca.vec(x.T) for x in solve(*symbols)))
    forward = sum(ca.jtimes(outputs, x, d) for x, d in zip(symbols, along, strict=True))
    back = RNG.standard_normal(outputs.numel())
    reverse = [ca.jtimes(outputs, x, back, True) for x in symbols]
    pushed, *pulled = ca.Function("both", symbols, [forward, *reverse])(*point)
    np.testing.assert_allclose(pushed.full().ravel(), slope, atol=1e-8)
    paired = sum(np.sum(g.full().ravel() * np.ravel(d)) for g, d in zip(pulled, along, strict=True))
    assert abs(paired - back @ pushed.full().ravel()) < 1e-12 * np.abs(slope).sum()
    mapped = lv.jax.solver(system, lv.Spark(2), **call)
    gradient = jax.grad(lambda *x: mapped(*x)[-1, 0], (0, 1))
    rows = np.stack([point[0], start["y"]])
    alone = [gradient(y, *point[1:]) for y in rows]
    runs = counted(monkeypatch)
    found = jax.vmap(gradient, (0, None, None))(rows, *point[1:])
    assert runs == [2]
    for own, one in zip(found, zip(*alone, strict=True), strict=True):
        np.testing.assert_allclose(own, np.stack(one), rtol=1e-10)


def counted(monkeypatch):
    """Return the members of the runs that are made from now on, 0 for single ones."""
    runs = []

    def vjp(*args, **options):
        found = lv.vjp(*args, **options)
        runs.append(found[0].members or 0)
        return found

    monkeypatch.setattr(run, "vjp", vjp)
    return runs


def test_jax_maps_gradients_onto_one_ensemble(jax, monkeypatch):
    """Of starts, of parameters, and of starts beside their constraints."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1],
        lambda t, q, params: {"rod": ca.dot(q, q) - params.l**2},
        q=("x", "y"),
        params={"g": 9.81, "l": 2.0},
    )
    solve = lv.jax.solver(
        system, lv.Spark(2), wrt=["v", "params.l", "params.g"], **FLOW, q=[1.2, -1.6]
    )

    def height(v, length, g):
        return solve(v, length, g)[-1, 1]

    v, lengths = RNG.standard_normal((3, 2)), np.array([1.9, 2.0, 2.1])
    alone = [jax.grad(height, (0, 1, 2))(*each, 9.81) for each in zip(v, lengths, strict=True)]
    runs = counted(monkeypatch)
    mapped = jax.jit(jax.vmap(jax.grad(height, (0, 1, 2)), (0, 0, None)))
    for own, one in zip(mapped(v, lengths, 9.81), zip(*alone, strict=True), strict=True):
        np.testing.assert_allclose(own, np.stack(one), rtol=1e-12)
    assert runs == [3]
    # what members share has one gradient where they are summed
    total = jax.grad(lambda g: jax.vmap(height, (0, 0, None))(v, lengths, g).sum())(9.81)
    np.testing.assert_allclose(total, np.stack([x[2] for x in alone]).sum(), rtol=1e-12)
    # two axes of members are one ensemble, and all directions at a point one run
    grid = jax.vmap(jax.vmap(jax.grad(height), (0, None, None)), (None, 0, None))
    runs.clear()
    assert grid(v, lengths, 9.81).shape == (3, 3, 2)
    assert runs == [9]
    runs.clear()
    forward = jax.jacfwd(lambda v: solve(v, 2.0, 9.81))(v[0])
    backward = jax.jacrev(lambda v: solve(v, 2.0, 9.81))(v[0])
    np.testing.assert_allclose(forward, backward, atol=1e-12)
    assert runs == [0]


def test_jax_maps_wave_functions_and_fields(jax, monkeypatch):
    """States and parameters are members of an ensemble, samples and ends are no member's own."""
    states = RNG.standard_normal((3, N)) + 1j * RNG.standard_normal((3, N))
    pulses = RNG.standard_normal((2, U.size))
    solve = lv.jax.solver(SYSTEM, METHOD, wrt=["psi", "drive[1]"], t=TIMES)
    slope = jax.grad(lambda psi, u: fidelity(solve(psi, u), jax.numpy), (0, 1))
    alone = [slope(psi, U) for psi in states], [slope(PSI, u) for u in pulses]
    runs = counted(monkeypatch)
    for axes, args, wanted in zip([(0, None), (None, 0)], [(states, U), (PSI, pulses)], alone,
                                  strict=True):  # fmt: skip
        for own, one in zip(jax.vmap(slope, axes)(*args), zip(*wanted, strict=True), strict=True):
            np.testing.assert_allclose(own, np.stack(one), rtol=1e-10, atol=1e-12)
    assert runs == [3, 0, 0]
    solve = lv.jax.solver(SYSTEM, METHOD, wrt=["psi", "params.a"], t=TIMES)
    slope = jax.grad(lambda psi, a: fidelity(solve(psi, a), jax.numpy), (0, 1))
    sizes = np.array([0.2, 0.6, 0.9])
    alone = [slope(PSI, a) for a in sizes]
    runs.clear()
    for axes, first in [((None, 0), PSI), ((0, 0), np.tile(PSI, (3, 1)))]:
        for own, one in zip(jax.vmap(slope, axes)(first, sizes), zip(*alone, strict=True),
                            strict=True):  # fmt: skip
            np.testing.assert_allclose(own, np.stack(one), rtol=1e-10, atol=1e-12)
    assert runs == [3]  # the second are the same runs
    runs.clear()
    flow = lv.jax.solver(abc_flow.system, lv.VolumeSplitting(), wrt=["x", "params.A", "t1"], **FLOW)
    x, ends = RNG.random((3, 3)), np.array([0.5, 0.8, 1.0])
    slope = jax.grad(lambda x, a, t1: flow(x, a, t1)[-1, 0], (0, 1, 2))
    runs.clear()
    assert [g.shape for g in jax.vmap(slope, (0, None, None))(x, 1.0, 1.0)] == [(3, 3), (3,), (3,)]
    assert [g.shape for g in jax.vmap(slope, (None, 0, None))(x[0], ends, 1.0)][1] == (3,)
    jax.vmap(slope, (None, None, 0))(x[0], 1.0, ends)
    assert runs == [3, 3, 0, 0, 0]


@pytest.mark.parametrize(("changes", "says"), [
    ({"wrt": ["psi", "t1"]}, "there is no direction 't1'"),
    ({"wrt": ["drive[0]"]}, r"there is no direction 'drive\[0\]'"),
    ({"wrt": ["psi"], "psi": PSI}, "'psi' is in wrt, and has a fixed value too"),
    ({"wrt": ["params.a"]}, "start value 'psi' is missing"),
    ({"returns": "q"}, "there is no state 'q'"),
    ({"method": lv.Lanczos(), "system": lv.Schrodinger(H), "wrt": ["psi"]}, "that have: 'auto'"),
    ({"method": "auto", "steps": 3}, "takes no steps"),
])  # fmt: skip
def test_a_wrong_call_is_refused_by_a_sentence(changes, says):
    call = {"system": SYSTEM, "method": METHOD, "wrt": WRT, "t": TIMES, **changes}
    with pytest.raises((TypeError, ValueError), match=says):
        lv.casadi.solver(**call)


def test_numbers_of_another_type_are_refused(torch):
    solve = lv.torch.solver(SYSTEM, METHOD, wrt=["psi"], t=TIMES)
    with pytest.raises(TypeError, match="'psi' must be of type complex128, not float64"):
        solve(torch.tensor(PSI.real))
