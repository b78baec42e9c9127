"""Runs as functions of JAX, PyTorch and CasADi have the derivatives of `vjp`, and those are right.

JAX and PyTorch are large, and only where they are installed are their tests run.
"""

import sys

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville._bridges import run
from liouville.problems import load

SYSTEM = lv.Lagrangian(
    lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1],
    lambda t, q, params: {"rod": ca.dot(q, q) - params.l**2},
    q=("x", "y"),
    params={"g": 9.81, "l": 2.0},
)
METHOD = lv.Spark(2)
WRT = ("q", "v", "params.l", "t1")
POINT = [np.array([1.2, -1.6]), np.array([1.6, 1.2]), np.array(2.0), np.array(0.5)]
RUN = {"t": (0.0, 0.5), "steps": 10, "every": 5}
CALL = {"wrt": WRT, "returns": ("q", "lam"), **RUN}
LIBRARIES = ("jax", "torch", "casadi")


def gradients():
    """Return the derivatives of the height at the end plus the multiplier midway, by `vjp`."""
    solution, pullback = lv.vjp(SYSTEM, METHOD, wrt=WRT, **RUN, q=POINT[0], v=POINT[1])
    of_q, of_lam = np.zeros_like(solution.q), np.zeros_like(solution.lam)
    of_q[-1, 1] = of_lam[1, 0] = 1
    return [*pullback(q=of_q, lam=of_lam).values()]


def scalar(q, lam):
    return q[-1, 1] + lam[1, 0]


def moving(solve, like):
    """Return the scalar as a function of an angle, its rate and a length: always on the rod."""

    def value(angle, rate, length):
        cosine, sine = like.cos(angle), like.sin(angle)
        q = like.stack([length * cosine, length * sine])
        v = like.stack([-rate * length * sine, rate * length * cosine])
        return scalar(*solve(q, v, length, like.ones_like(length) / 2))

    return value


def test_jax_has_the_gradients_of_vjp_in_all_its_modes(jax):
    solve = lv.jax.solver(SYSTEM, METHOD, **CALL)

    def cost(*inputs):
        return scalar(*solve(*inputs))

    every, expected = tuple(range(len(WRT))), gradients()
    value, found = jax.jit(jax.value_and_grad(cost, every))(*POINT)
    assert value == cost(*POINT)
    for own in (found, jax.grad(cost, every)(*POINT)):
        assert all(map(np.array_equal, own, expected))
    forward = jax.jacfwd(cost, every)(*POINT)
    for own, wanted in zip(forward, expected, strict=True):
        np.testing.assert_allclose(own, wanted, rtol=1e-11)
    # members, each with its own gradient, in either order
    many = np.stack([POINT[1], -POINT[1]])
    axes = (None, 0, None, None)
    each = np.stack([jax.grad(cost, 1)(POINT[0], v, *POINT[2:]) for v in many])
    mapped = jax.vmap(jax.grad(cost, 1), axes)
    np.testing.assert_array_equal(jax.jit(mapped)(POINT[0], many, *POINT[2:]), each)
    summed = jax.grad(lambda v: jax.vmap(cost, axes)(POINT[0], v, *POINT[2:]).sum())
    np.testing.assert_array_equal(summed(many), each)
    with pytest.raises(NotImplementedError, match="first derivatives only"):
        jax.hessian(cost, 1)(*POINT)


def test_jax_differences_of_a_motion_on_its_constraints(jax):
    value = moving(lv.jax.solver(SYSTEM, METHOD, **CALL), jax.numpy)
    at = (-0.9, 0.7, 1.7)
    found = jax.grad(value, (0, 1, 2))(*at)
    for k, slope in enumerate(found):
        step = np.eye(3)[k] * 1e-4
        one, two = (float(value(*(at + m * step)) - value(*(at - m * step))) for m in (1, 2))
        assert float(slope) == pytest.approx((8 * one - two) / 12e-4, abs=1e-9)


def test_jax_without_numbers_of_64_bits_is_refused(jax):
    solve = lv.jax.solver(SYSTEM, METHOD, **CALL)
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(ValueError, match="has numbers of 32 bits, and runs take 64"):
        solve(*POINT)


@pytest.mark.filterwarnings("ignore:.torch.jit.script")  # PyTorch's own, in forward mode
def test_torch_has_the_gradients_of_vjp_and_passes_gradcheck(torch):
    solve = lv.torch.solver(SYSTEM, METHOD, **CALL)
    inputs = [torch.tensor(x, requires_grad=True) for x in POINT]
    scalar(*solve(*inputs)).backward()
    assert all(map(np.array_equal, [x.grad.numpy() for x in inputs], gradients()))
    assert torch.autograd.gradcheck(solve, inputs, check_forward_ad=True)
    along = [torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in (-0.9, 0.7, 1.7)]
    assert torch.autograd.gradcheck(moving(solve, torch), along)
    assert solve(*inputs[:3], 0.5)[0].dtype == torch.float64


@pytest.mark.filterwarnings("ignore:.torch.jit.script")
def test_torch_func_has_gradients_and_one_ensemble_of_mapped_ones(torch, monkeypatch):
    runs = []
    monkeypatch.setattr(run, "vjp", lambda *a, **options: runs.append(a) or lv.vjp(*a, **options))
    solve = lv.torch.solver(SYSTEM, METHOD, **CALL)
    inputs, func = [torch.tensor(x) for x in POINT], torch.func

    def cost(*inputs):
        return scalar(*solve(*inputs))

    every, expected = tuple(range(len(WRT))), gradients()
    reverse = func.grad(cost, every)(*inputs)
    assert all(map(np.array_equal, reverse, expected))
    for found in (func.jacfwd(cost, every)(*inputs), func.jacrev(cost, every)(*inputs)):
        for own, wanted in zip(found, expected, strict=True):
            np.testing.assert_allclose(own, wanted, rtol=1e-11)
    assert len(runs) == 1
    # members, each with its own gradient, in either order
    many, axes = torch.stack([inputs[1], -inputs[1]]), (None, 0, None, None)
    each = torch.stack([func.grad(cost, 1)(inputs[0], v, *inputs[2:]) for v in many])
    mapped = func.vmap(func.grad(cost, 1), axes)(inputs[0], many, *inputs[2:])
    leaf = many.clone().requires_grad_()
    func.vmap(cost, axes)(inputs[0], leaf, *inputs[2:]).sum().backward()
    for found in (mapped, leaf.grad):
        np.testing.assert_array_equal(found, each)
    assert len(runs) == 3  # the other point, and an ensemble of both


def test_torch_differentiates_derivatives_by_what_they_are_linear_in_alone(torch):
    """Second derivatives by the inputs are refused: they are not zero."""
    solve = lv.torch.solver(SYSTEM, METHOD, **CALL)
    q, v, length, t1 = (torch.tensor(x) for x in POINT)

    def height(v):
        return solve(q, v, length, t1)[0][-1, 1]

    functional = torch.autograd.functional
    _, along = functional.jvp(height, v, v)
    assert float(along) == pytest.approx(float(torch.func.grad(height)(v) @ v), rel=1e-11)
    leaf, weight = v.requires_grad_(), torch.tensor(2.0, requires_grad=True, dtype=v.dtype)
    (slope,) = torch.autograd.grad(weight * height(leaf), leaf, create_graph=True)
    (by_weight,) = torch.autograd.grad(slope.sum(), weight, retain_graph=True)
    assert float(by_weight) == pytest.approx(float(slope.detach().sum()) / 2, rel=1e-11)

    def forward_over_reverse():
        with torch.autograd.forward_ad.dual_level():
            dual = torch.autograd.forward_ad.make_dual(leaf, v.detach())
            torch.autograd.grad(height(dual), dual)

    for second in (
        lambda: functional.hessian(height, v.detach()),
        lambda: torch.func.hessian(height)(v.detach()),
        lambda: slope.sum().backward(),
        forward_over_reverse,
    ):
        with pytest.raises(NotImplementedError, match="first derivatives only"):
            second()


def test_tensors_that_are_fixed_are_copied_and_have_no_gradient(torch):
    q, g = torch.tensor(POINT[0]), torch.tensor(9.81, dtype=torch.float64)
    call = {**CALL, "wrt": ["v"], "q": q}
    solve = lv.torch.solver(SYSTEM, METHOD, **call, params={"g": g})
    wanted = solve(torch.tensor(POINT[1]))[0]
    g.mul_(2)
    q.mul_(2)
    solve(torch.tensor(-POINT[1]))
    assert torch.equal(solve(torch.tensor(POINT[1]))[0], wanted)
    sentence = "'params.g' requires a gradient, and is fixed here\\nhint: write 'params.g' into wrt"
    with pytest.raises(TypeError, match=sentence):
        lv.torch.solver(SYSTEM, METHOD, **call, params={"g": g.requires_grad_()})


def test_casadi_has_the_gradients_of_vjp_from_one_run(monkeypatch):
    runs = []
    monkeypatch.setattr(run, "vjp", lambda *a, **options: runs.append(a) or lv.vjp(*a, **options))
    solve = lv.casadi.solver(SYSTEM, METHOD, **CALL)
    assert solve.name_in() == ["q", "v", "params_l", "t1"]
    symbols = [ca.MX.sym("x", *np.shape(x)) for x in POINT]
    q, lam = solve(*symbols)
    reverse = [ca.gradient(scalar(q, lam), x) for x in symbols]
    forward = [ca.jacobian(ca.vertcat(q[-1, 1], lam[1]), x) for x in symbols]
    found = ca.Function("derivatives", symbols, [*reverse, *forward])(*POINT)
    assert len(runs) == 1
    for k, expected in enumerate(gradients()):
        np.testing.assert_array_equal(found[k].full().ravel(), np.ravel(expected))
        both = found[k + 4].full().sum(axis=0)
        np.testing.assert_allclose(both, np.ravel(expected), rtol=1e-11)


def test_ipopt_finds_the_velocity_that_brings_a_pendulum_to_a_place():
    own = {"t": (0, 1), "steps": 20}
    solve = lv.casadi.solver(SYSTEM, METHOD, wrt=["v"], every=20, **own, q=[0.0, -2.0])
    v = ca.MX.sym("v", 2)
    place = 2 * np.array([np.sin(2.0), -np.cos(2.0)])
    problem = {"x": v, "f": ca.sumsqr(v), "g": solve(v)[-1, 1] - place[1]}
    options = {"ipopt.hessian_approximation": "limited-memory", "ipopt.print_level": 0}
    options |= {"ipopt.sb": "yes", "print_time": False}
    optimum = ca.nlpsol("aim", "ipopt", problem, options)
    found = optimum(x0=[5.0, 1.0], lbg=0, ubg=0)  # off the hidden constraint
    assert optimum.stats()["return_status"] == "Solve_Succeeded"
    velocity = found["x"].full().ravel()
    start = SYSTEM.consistent(q=[0.0, -2.0], v=velocity)
    end = lv.integrate(SYSTEM, METHOD, **own, **start).q[-1]
    np.testing.assert_allclose(end, place, atol=1e-6)
    assert abs(velocity[1]) < 1e-6  # across the rod is wasted


def test_a_solver_keeps_what_it_was_given():
    given = {"q": np.array([1.2, -1.6]), "params": {"g": np.array(9.81)}}
    solve = lv.casadi.solver(SYSTEM, METHOD, **{**CALL, "wrt": ["v"]}, **given)
    wanted = solve(POINT[1])[0].full()
    given["q"] *= 2
    given["params"]["g"][()] = 5.0
    np.testing.assert_array_equal(solve(-POINT[1])[0].full()[0], POINT[0])
    np.testing.assert_array_equal(solve(POINT[1])[0].full(), wanted)


def test_second_derivatives_in_casadi_are_refused_by_a_sentence():
    solve = lv.casadi.solver(SYSTEM, METHOD, **{**CALL, "wrt": ["v"]}, q=POINT[0])
    v = ca.MX.sym("v", 2)
    aim = {"x": v, "f": solve(v)[0][-1, 1]}
    for second in (lambda: ca.hessian(aim["f"], v), lambda: ca.nlpsol("aim", "ipopt", aim)):
        with pytest.raises(RuntimeError, match=r"first derivatives only.*\nhint: IPOPT takes"):
            second()


def test_velocities_off_the_constraints_have_the_right_derivatives():
    solve = lv.casadi.solver(SYSTEM, METHOD, wrt=["v", "t1"], **RUN, q=POINT[0])
    v, d = np.array([1.0, 3.0]), np.array([0.3, -0.4])
    one, two = ((solve(v + m * d, 0.5) - solve(v - m * d, 0.5)).full() for m in (1e-3, 2e-3))
    symbol = ca.MX.sym("v", 2)
    found = ca.Function("along", [symbol], [ca.jtimes(solve(symbol, 0.5), symbol, d)])(v)
    np.testing.assert_allclose(found.full(), (8 * one - two) / 12e-3, atol=1e-9)


def test_starts_off_the_constraints_have_the_derivatives_of_the_start_moved():
    """Positions and velocities bend on their way onto the constraints, which differences see."""
    for off in [(POINT[0], POINT[1], 2.1, 0.5), ([1.3, -1.4], [1.0, 3.0], 2.0, 0.5)]:
        solve = lv.casadi.solver(SYSTEM, METHOD, **CALL)
        rng = np.random.default_rng(1)
        along = [rng.standard_normal(np.shape(x)) for x in off]
        values = {}
        for m in (1, -1, 2, -2, 3, -3):
            moved = [np.asarray(x) + m * 2e-3 * d for x, d in zip(off, along, strict=True)]
            values[m] = np.concatenate([x.full().ravel() for x in solve(*moved)])
        weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
        slope = sum(w / 2e-3 * (values[m] - values[-m]) for m, w in weights.items())
        symbols = [ca.MX.sym("x", *np.shape(x)) for x in off]
        outputs = ca.vertcat(*(ca.vec(x.T) for x in solve(*symbols)))
        d = [ca.MX.sym("d", *np.shape(x)) for x in off]
        back = ca.MX.sym("back", outputs.numel())
        pairs = zip(symbols, d, strict=True)
        forward = sum(ca.jtimes(outputs, x, own) for x, own in pairs)
        reverse = [ca.jtimes(outputs, x, back, True) for x in symbols]
        cotangent = rng.standard_normal(outputs.numel())
        function = ca.Function("both", [*symbols, *d, back], [forward, *reverse])
        pushed, *pulled = function(*off, *along, cotangent)
        np.testing.assert_allclose(pushed.full().ravel(), slope, rtol=0, atol=1e-8)
        pairs = zip(pulled, along, strict=True)
        paired = sum(float(np.sum(x.full().ravel() * np.ravel(own))) for x, own in pairs)
        assert abs(paired - cotangent @ pushed.full().ravel()) < 1e-12 * np.abs(slope).sum()


def test_redundant_constraints_have_derivatives_at_starts_on_them(capsys):
    problem = load("doubled_rod")
    start = problem.start
    solve = lv.casadi.solver(
        problem.system, lv.Spark(2), wrt=["v"], t=(0, 0.1), steps=2, q=1.01 * np.asarray(start["q"])
    )
    v = ca.MX.sym("v", len(start["v"]))
    slope = ca.Function("slope", [v], [ca.gradient(solve(v)[-1, 1], v)])
    with pytest.raises(RuntimeError, match="derivatives are then taken at starts on all"):
        slope(start["v"])
    # CasADi prints what a callback raises, of which the sentence is enough
    printed = capsys.readouterr().err
    assert printed.count("derivatives are then taken at starts on all") == 1
    assert printed.count("  File ") == 1


@pytest.mark.parametrize(("changes", "sentence"), [
    ({"wrt": ["w"]}, "there is no direction 'w'"),
    ({"wrt": ["v", "v"]}, "wrt must name each input once"),
    ({"wrt": ["v"]}, "start value 'q' is missing"),
    ({"q": [0.0, -2.0]}, "'q' is in wrt, and has a fixed value too"),
    ({"params": {"l": 2.0}}, "'params.l' is in wrt, and has a fixed value too"),
    ({"x": [0.0]}, "'x' is no start value"),
    ({"returns": "energy"}, "there is no state 'energy'"),
    ({"returns": ("q", "q")}, "returns must name each state once"),
    ({"returns": ()}, "returns must be the name of a state"),
    ({"method": lv.Spark(2, newton_tol=1e-6)}, "newton_tol"),
    ({"steps": None}, "give either h or steps"),
])  # fmt: skip
def test_a_wrong_call_is_refused_by_a_sentence(changes, sentence):
    with pytest.raises((TypeError, ValueError), match=sentence):
        lv.casadi.solver(**{"system": SYSTEM, "method": METHOD, **CALL, **changes})


@pytest.mark.parametrize("name", ["jax", "torch"])
def test_wrong_inputs_are_refused_by_a_sentence(name, request):
    library = request.getfixturevalue(name)
    array = library.numpy.array if name == "jax" else library.tensor
    solve = getattr(lv, name).solver(SYSTEM, METHOD, **CALL)
    q, *others = map(array, POINT)
    for bad, sentence in (
        ([array([1.0, -2.0]).astype("float32") if name == "jax" else q.float(), *others],
         "'q' must be of type float64, not float32"),
        ([array([1.0, 0.0, 0.0]).astype("float64") if name == "jax" else q.new_zeros(3), *others],
         r"'q' must have shape \(2,\), not \(3,\)"),
        ([q, *others[:2]], "the solver takes 4 arrays, not 3\nhint: in the order of wrt: q, v"),
        ([q * np.nan, *others], "'q' must be finite"),
        ([q, *others[:2], "1"], "inputs must be tensors|not a valid JAX|valid JAX array type"),
    ):  # fmt: skip
        with pytest.raises((TypeError, ValueError, RuntimeError), match=sentence):
            solve(*bad)


@pytest.mark.parametrize("name", ["jax", "torch"])
def test_a_library_that_is_missing_is_named_with_its_extra(name, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    hint = rf'needs {name}\nhint: pip install "liouville\[{name}\]"'
    with pytest.raises(ImportError, match=hint):
        getattr(lv, name).solver(SYSTEM, METHOD, **CALL)


BALL = lv.Lagrangian(
    lambda t, q, v, params: v[0] ** 2 / 2 - params.g * q[0], q=("x",),
    params={"g": 1.0, "e": 0.5},
)  # fmt: skip
FLOOR = {
    "floor": lv.Event(
        lambda t, q, v, lam, params: q[0], direction="down",
        reset=lv.Impact(lambda t, q, v, lam, params: params.e),
    )
}  # fmt: skip
BOUNCE = {"wrt": ("params.g", "params.e"), "returns": "v", "events": FLOOR, "q": [0.5], "v": [0.0]}


def bounced(g, e):
    """Return the velocity at t = 1.5 of a ball dropped from 1/2, and its derivatives by g and e."""
    first = g**-0.5
    value = e * g**0.5 - g * (1.5 - first)
    return value, (e / 2 * g**-0.5 - 1.5 + first / 2, g**0.5)


@pytest.mark.parametrize("steps", [{"steps": 15}, {"rtol": 1e-10}], ids=["equal", "rtol"])
def test_casadi_differentiates_through_impacts_at_chosen_times(steps):
    solve = lv.casadi.solver(BALL, METHOD, t=(0, 1.5), t_eval=[0.4, 1.5], **BOUNCE, **steps)
    symbols = [ca.MX.sym("g"), ca.MX.sym("e")]
    end = solve(*symbols)[-1, 0]
    found = ca.Function("f", symbols, [end, *(ca.gradient(end, x) for x in symbols)])(1.21, 0.5)
    value, slopes = bounced(1.21, 0.5)
    assert [float(x) for x in found] == pytest.approx([value, *slopes], abs=1e-9)


@pytest.mark.parametrize("steps", [{"steps": 15}, {"rtol": 1e-10}], ids=["equal", "rtol"])
def test_jax_differentiates_through_impacts_of_members(jax, steps):
    solve = lv.jax.solver(BALL, METHOD, t=(0, 1.5), t_eval=[1.5], **BOUNCE, **steps)
    gs = np.array([0.9, 1.0, 1.21])
    slopes = jax.jit(jax.vmap(jax.grad(lambda g: solve(g, 0.5)[0, 0])))(gs)
    np.testing.assert_allclose(slopes, [bounced(g, 0.5)[1][0] for g in gs], atol=1e-9)


#: The ball of :data:`BALL` with its floor as a contact.
TOUCHING = lv.Lagrangian(
    lambda t, q, v, params: v[0] ** 2 / 2 - params.g * q[0], q=("x",), params={"g": 1.0, "e": 0.5},
    contacts={"floor": lv.Contact(lambda t, q, params: q[0], restitution=lambda params: params.e)},
)  # fmt: skip
TOUCHED = {"wrt": ("params.g", "params.e"), "returns": "v", "q": [0.5], "v": [0.0]}


@pytest.mark.parametrize("records", [{"every": 5}, {"t_eval": [0.3, 0.7, 1.1, 1.5]}], ids=str)
def test_jax_differentiates_through_contacts_of_members(jax, records):
    """States at hits are not among those returned, and members that fail have NaN."""
    solve = lv.jax.solver(TOUCHING, METHOD, t=(0, 1.5), steps=15, **records, **TOUCHED)
    assert solve(1.0, 0.5).shape == (4, 1)
    gs, es = np.array([0.9, 1.0, 1.0, 1.21]), np.array([0.5, 0.5, 1.5, 0.6])
    found = jax.jit(jax.vmap(jax.grad(lambda g, e: solve(g, e)[-1, 0], argnums=(0, 1))))(gs, es)
    wanted = [bounced(g, e)[1] if e < 1 else (np.nan, np.nan) for g, e in zip(gs, es, strict=True)]
    np.testing.assert_allclose(np.transpose(found), wanted, atol=1e-9)
    assert list(solve.failures) == [2]
    assert "restitution of contact 'floor' must be from 0 to 1, not 1.5" in solve.failures[2]
    push = jax.jvp(lambda e: solve(1.0, e)[-1, 0], (0.5,), (1.0,))
    assert [float(x) for x in push] == pytest.approx([-0.0, 1.0], abs=1e-9)


def test_casadi_differentiates_through_contacts():
    call = {"t": (0, 1.5), "steps": 15, "every": 15, **TOUCHED}
    symbols = [ca.MX.sym("g"), ca.MX.sym("e")]
    end = lv.casadi.solver(TOUCHING, METHOD, **call)(*symbols)[-1, 0]
    found = ca.Function("f", symbols, [ca.gradient(end, x) for x in symbols])(1.21, 0.5)
    assert [float(x) for x in found] == pytest.approx(bounced(1.21, 0.5)[1], abs=1e-9)


def test_torch_differentiates_through_contacts(torch):
    call = {"t": (0, 1.5), "steps": 15, "every": 15, **TOUCHED}
    point = [torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in (1.21, 0.5)]
    lv.torch.solver(TOUCHING, METHOD, **call)(*point)[-1, 0].backward()
    assert [float(x.grad) for x in point] == pytest.approx(bounced(1.21, 0.5)[1], abs=1e-9)


@pytest.mark.parametrize(("changes", "sentence"), [
    ({"rtol": 1e-6}, "runs with contacts want equal steps: give h or steps"),
    ({"steps": 15, "wrt": ("t1",)}, "runs with contacts go without 't0' and 't1'"),
])  # fmt: skip
def test_what_contacts_have_no_gradients_of_is_refused_when_a_solver_is_made(changes, sentence):
    with pytest.raises(TypeError, match=sentence):
        lv.casadi.solver(TOUCHING, METHOD, **{"t": (0, 1.5), **TOUCHED, **changes})


@pytest.mark.parametrize("name", ["jax", "torch"])
def test_solvers_take_whole_numbers_and_names_and_are_pickled(name, request):
    import pickle

    like = request.getfixturevalue(name)
    like = like.numpy if name == "jax" else like
    solve = getattr(lv, name).solver(SYSTEM, METHOD, **CALL)
    *states, length, end = (like.asarray(x, dtype=like.float64) for x in POINT)
    wanted = solve(*states, length, end)[0]
    for two in (2, np.int64(2), like.asarray(2)):
        np.testing.assert_array_equal(solve(*states, two, t1=0.5)[0], wanted)
        np.testing.assert_array_equal(solve(*states, l=two, t1=0.5)[0], wanted)
    again = pickle.loads(pickle.dumps(solve))
    np.testing.assert_array_equal(again(*states, length, end)[0], wanted)
    assert "(q (2,), v (2,), params.l (), t1 ()) -> (q (3, 2), lam (3, 1))" in solve.__doc__
    assert f"<lv.{name}.solver: Run Lagrangian by Spark(stages=2)" in repr(solve)
    with pytest.raises(TypeError, match=r"has no input 'g'\nhint: there are q, v, params\.l, t1"):
        solve(*states, length, g=1.0)
    with pytest.raises(TypeError, match=r"is given 'params\.l' twice"):
        solve(*states, length, end, l=1.0)
    narrow = like.asarray(2.0, dtype=like.float32)
    with pytest.raises(TypeError, match=r"'params\.l' must be of .*, not float32\nhint: runs take"):
        solve(*states, narrow, end)


def test_methods_are_called_by_their_names():
    free = {"wrt": ("q",), "returns": "q", **RUN, "v": POINT[1]}
    point = POINT[0]
    for name, method in (("auto", lv.Spark(3)), ("spark", lv.Spark())):
        found, wanted = (lv.casadi.solver(SYSTEM, x, **free)(point) for x in (name, method))
        np.testing.assert_array_equal(np.array(found), np.array(wanted))
    with pytest.raises(TypeError, match="method must be a method or its name, not 'sparks'"):
        lv.casadi.solver(SYSTEM, "sparks", **free)


def test_jax_has_nan_for_a_member_that_fails_and_says_why(jax):
    """A pole of the force at x = 1 stops the member that falls into it."""
    system = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 + ca.log(1 - q[0]), q=("x",)
    )  # fmt: skip
    solve = lv.jax.solver(
        system, METHOD, wrt=("v",), returns="q", t=(0, 1), steps=4, every=4, q=[0.0]
    )
    starts = np.array([[0.1], [0.2], [9.0]])
    value = jax.vmap(lambda v: solve(v)[-1, 0])(starts)
    slope = jax.vmap(jax.grad(lambda v: solve(v)[-1, 0]))(starts)
    assert list(solve.failures) == [2]
    assert solve.failures[2].startswith("step ")
    for found in (value, slope.ravel()):
        np.testing.assert_array_equal(np.isnan(found), [False, False, True])
    alone = jax.grad(lambda v: solve(v)[-1, 0])(starts[1])
    np.testing.assert_allclose(slope[1], alone, rtol=1e-12)


def test_torch_says_which_members_have_failed(torch):
    solve = lv.torch.solver(SYSTEM, METHOD, **{**CALL, "wrt": ("v", "params.l"), "q": POINT[0]})
    lengths = torch.tensor([2.0, torch.nan, 0.0])
    found = torch.func.vmap(lambda x: solve(torch.tensor(POINT[1]), x)[0])(lengths.double())
    np.testing.assert_array_equal(found.isnan().any(dim=(1, 2)), [False, True, True])
    assert list(solve.failures) == [1, 2]
    assert solve.failures[1].startswith("'params.l' must be finite, not ")


def test_jax_has_nan_for_members_that_are_no_numbers_or_have_no_derivative(jax):
    """Others go on: those that begin at no number, at no place on the constraint, at a kink."""
    solve = lv.jax.solver(SYSTEM, METHOD, **{**CALL, "wrt": ("v", "params.l"), "q": POINT[0]})
    lengths = np.array([2.0, np.nan, 0.0, 1.9])
    by_length = jax.grad(lambda length: solve(POINT[1], length)[0][-1, 0])
    slope = jax.vmap(by_length)(lengths)
    np.testing.assert_array_equal(np.isnan(slope), [False, True, True, False])
    assert solve.failures[1].startswith("'params.l' must be finite, not ")
    assert slope[3] == by_length(1.9)
    bent = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2, force=lambda t, q, v, params: -ca.fabs(v), q=("x",)
    )
    solve = lv.jax.solver(bent, METHOD, wrt=("v",), returns="q", t=(0, 1), steps=80, q=[0.0])
    speeds = np.array([[1.0], [0.0], [2.0]])
    slope = jax.vmap(jax.grad(lambda v: solve(v)[-1, 0]))(speeds)
    np.testing.assert_allclose(slope.ravel(), [1 - np.exp(-1), np.nan, 1 - np.exp(-1)], atol=1e-10)
    assert "kink of 'fabs(v[0])'" in solve.failures[1]


@pytest.mark.parametrize(("changes", "sentence"), [
    ({"steps": None, "every": 1, "rtol": 1e-6, "wrt": ("v",), "q": POINT[0]},
     "an array has one shape\nhint: give t_eval="),
    ({"events": {"up": lv.Event(lambda t, q, v, lam, params: q[1], terminal=True)}},
     "event 'up' ends the run, and an array has one shape"),
    ({"steps": None, "every": 1, "rtol": 1e-6, "t_eval": [0.5]}, "no derivative by 't1' where"),
])  # fmt: skip
def test_results_have_one_shape(changes, sentence):
    with pytest.raises((TypeError, ValueError), match=sentence):
        lv.casadi.solver(SYSTEM, METHOD, **{**CALL, **changes})
