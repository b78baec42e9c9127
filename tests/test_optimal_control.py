"""Optimal control: orders, published optima, what is kept, and what is refused."""

from functools import partial

import casadi as ca
import numpy as np
import pytest
from ordinary import solved

import liouville as lv
from liouville._studies.optimal import program

# A pendulum on a cart, from rest below to rest above in 3 s, with gravity 1: what minimises its
# effort, in minimal coordinates (X, theta) by Pontryagin and shooting in 34 digits. Costates at the
# start, and all at half time with the cost so far: from there roundings grow least, to 1e-11 and
# not to 1e-8.
COSTATES = (-40.81255006436954, 5.07496110579922, -89.64596111775939, -81.63423054365634)
LEAST = 31.569328809393697
HALFWAY = (
    -0.48271510481428770, 0.64841816332246355, -2.8346256975777277, 2.9604799724648152,
    -40.812550064369537, -56.704063233611100, -28.427136021205080, -35.123316661195348,
    11.906837001984390,
)  # fmt: skip


def lagrangian(t, q, v, params):
    return v[0] ** 2 / 2 + (v[1] ** 2 + v[2] ** 2) / 4 - q[2] / 2


def rod(t, q, params):
    return {"rod": ((q[1] - q[0]) ** 2 + q[2] ** 2 - params.l**2) / 2}


CART = lv.Lagrangian(
    lagrangian,
    rod,
    force=lambda t, q, v, params: [params.F, 0, 0],
    q=("X", "x", "y"),
    params={"F": 0.0, "l": 1.0, "idle": 0.0},
)
UPRIGHT = {"q": [0, 0, 1], "v": [0, 0, 0]}
ANGLES = np.pi * np.linspace(0, 1, 41) ** 4 - 1.5 * np.sin(np.pi * np.linspace(0, 1, 41)) ** 2
PUMPED = {"q": np.stack([0 * ANGLES, np.sin(ANGLES), -np.cos(ANGLES)], axis=1)}


def effort(t, q, v, params):
    return params.F**2 / 2


def swing(stages=2, steps=40, system=CART, **more):
    given = {
        "controls": ("F",), "cost": effort, "t": (0, 3), "steps": steps, "q": [0, 0, -1],
        "v": [0, 0, 0], "final": UPRIGHT, "guess": PUMPED,
    }  # fmt: skip
    return lv.optimal_control(system, lv.Spark(stages), **{**given, **more})


@pytest.fixture(scope="module")
def swung():
    return swing(3, 48)


@pytest.fixture(scope="module")
def pontryagin():
    """Return cart, angle, their rates and the control as a function of time, and the cost."""
    x, u = ca.SX.sym("x", 8), ca.SX.sym("u")
    _, angle, speed, rate, *_ = ca.vertsplit(x)
    mass = ca.blockcat([[1.5, ca.cos(angle) / 2], [ca.cos(angle) / 2, 0.5]])
    force = ca.vertcat(u + ca.sin(angle) * rate**2 / 2, -ca.sin(angle) / 2)
    f = ca.vertcat(speed, rate, ca.solve(mass, force))
    least = -ca.dot(x[4:], ca.jacobian(f, u))
    hamiltonian = ca.substitute(u**2 / 2 + ca.dot(x[4:], f), u, least)
    rates = ca.vertcat(ca.substitute(f, u, least), -ca.gradient(hamiltonian, x[:4]), least**2 / 2)
    field, control = ca.Function("field", [x], [rates]), ca.Function("control", [x], [least])
    nodes, rates_at = np.arange(241) / 80, lambda t, y: np.array(field(y[:8])).ravel()
    before, after = (solved(rates_at, part, HALFWAY) for part in (nodes[120::-1], nodes[120:]))
    run = np.concatenate([before[:0:-1], after])

    def at(t):
        y = run[np.round(80 * t).astype(int)].T
        return y[:4], np.array(control.map(t.size)(y[:8])).ravel()

    return at, run[-1, 8] - run[0, 8]


def errors(found, reference):
    """Return the errors of cost, states, and controls at nodes."""
    at, cost = reference
    (X, angle, speed, rate), u = at(found.t)
    q = np.stack([X, X + np.sin(angle), -np.cos(angle)], axis=1)
    v = np.stack([speed, speed + np.cos(angle) * rate, np.sin(angle) * rate], axis=1)
    states = max(np.abs(found.q - q).max(), np.abs(found.v - v).max())
    return np.array([abs(found.cost - cost), states, np.abs(found.controls["F"] - u).max()])


@pytest.mark.parametrize(("stages", "steps"), [(1, (40, 80)), (2, (40, 80)), (3, (48, 80))])
def test_cost_states_and_controls_at_nodes_have_the_order_of_pontryagin_s(
    stages, steps, swung, pontryagin
):
    assert abs(pontryagin[1] - LEAST) < 1e-10
    coarse, fine = (errors(swing(stages, N, guess=swung), pontryagin) for N in steps)
    orders = np.log(coarse / fine) / np.log(steps[1] / steps[0])
    assert (orders > 2 * stages - 0.15).all(), orders


def test_a_fine_optimum_is_that_of_shooting(swung):
    found = swing(4, 64, guess=swung)
    assert abs(found.cost - LEAST) < 1e-9
    # costates by the position and the momentum of the start, in minimal coordinates
    ways = np.array([[1, 0], [1, 1], [0, 0]])
    by_velocity = np.array([1, 0.5, 0.5]) * found.costates["p"][0]
    costates = [*(ways.T @ found.costates["q"][0]), *(ways.T @ by_velocity)]
    np.testing.assert_allclose(costates, COSTATES, rtol=0, atol=1e-6)


def test_the_published_optimum_of_a_pendulum_in_cartesian_coordinates():
    # Betts, A Collection of Optimal Control Test Problems, 10.103: 12.8738850
    pendulum = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - 9.81 * q[1],
        lambda t, q, params: ca.dot(q, q) - 1,
        force=lambda t, q, v, params: [params.u * q[1], -params.u * q[0]],
        q=("x", "y"),
        params={"u": 0.0},
    )
    found = lv.optimal_control(
        pendulum, lv.Spark(3), controls=("u",), cost=lambda t, q, v, params: params.u**2,
        t=(0, 3), steps=40, q=[1, 0], v=[0, 0], final={"q": {"x": 0}, "v": {"x": 0}},
    )  # fmt: skip
    assert abs(found.cost / 12.8738850 - 1) < 1e-6


def test_a_run_of_the_controls_is_the_motion_and_momentum_changes_by_the_impulse(swung):
    run = swung.solution
    for name in ("q", "v", "p"):
        assert np.abs(run.states[name] - swung.states[name]).max() < 1e-12
    assert np.abs(run.residuals["constraint"]).max() < 1e-14
    impulse = swung.h * (swung.stage_controls["F"] @ swung.weights)
    momentum = swung.p[:, 0] + swung.p[:, 1]
    assert np.abs(momentum - np.append(0, np.cumsum(impulse))).max() < 1e-13
    # the gradient of the constraint and the costate of the momentum are at right angles
    across = np.stack([swung.q[:, 0] - swung.q[:, 1], swung.q[:, 1] - swung.q[:, 0], swung.q[:, 2]])
    mixed = np.sum(across.T * swung.costates["p"], axis=1)
    assert np.abs(mixed).max() < 1e-9 * np.abs(swung.costates["p"]).max()
    work = np.abs(run.invariants["energy"][-1] - run.invariants["energy"][0])
    assert abs(work - 1.0) < 1e-4  # half a unit of mass, lifted by two


@pytest.fixture(scope="module")
def general():
    """Return a system that dissipates, with nonlinear momentum, velocity and reaction."""
    return lv.Mechanical(
        velocity=lambda t, y, z, params: [z[0] * (1 + y[0] ** 2 / 10), z[1], z[2] + z[1] / 10],
        momentum=lambda t, y, z, params: [
            z[0] * (1 + z[0] ** 2 / 5) + ca.sin(t) / 10, (1 + 0.3 * y[0] ** 2) * z[1], z[2],
        ],
        force=lambda t, y, z, params: [
            params.u[0] - y[0] - 0.2 * z[0], params.u[1] * y[0] - y[1], -y[2] - 0.1 * z[2] ** 3,
        ],
        constraint=lambda t, y, params: ca.dot(y, y) - 1 - ca.sin(t) / 10,
        reaction=lambda t, y, lam, params: -(lam + lam**3 / 10) * y,
        y=("a", "b", "c"),
        params={"u": (0.0, 0.0)},
    )  # fmt: skip


def test_costates_of_a_general_system_are_derivatives_of_the_cost(general):
    def best(z):
        start = general.consistent(y=[1, 0, 0.2], z=z, hold=None)
        return start, lv.optimal_control(
            general, lv.Spark(2), controls=("u",), t=(0, 1), steps=8,
            cost=lambda t, y, z, params: ca.dot(params.u, params.u) / 2 + y[0] ** 2,
            final_cost=lambda t, y, z, params: y[1] ** 2 + z[2] ** 2, **start,
        )  # fmt: skip

    start, found = best([0, 1, 0.3])
    moved, other = best([0, 1 + 1e-4, 0.3])
    _, back = best([0, 1 - 1e-4, 0.3])
    z = start["z"]
    slope = np.array([1 + 0.6 * z[0] ** 2, 1 + 0.3 * start["y"][0] ** 2, 1.0])
    change = slope * (moved["z"] - z) @ found.costates["p"][0]
    assert abs((other.cost - back.cost) / 2 / change - 1) < 1e-6
    assert np.abs(found.solution.z - found.z).max() < 1e-12
    assert np.abs(found.controls["u"][-1]).max() > 1e-3  # the final cost is felt


def test_a_quaternion_turns_about_a_fixed_axis_as_it_is_known_to():
    m = lv.bodies.Assembly()
    m.body("satellite", mass=1.0, inertia=(1.0, 2.0, 3.0), at=(0, 0, 0))
    m.free("flight", "satellite")
    m.torque("jets", "satellite", lambda t, rate, params: params.torque)
    satellite = m.system(params={"torque": (0.0, 0.0, 0.0)})
    found = lv.optimal_control(
        satellite, lv.Spark(3), controls=("torque",), t=(0, 2), steps=12,
        cost=lambda t, q, v, params: ca.dot(params.torque, params.torque) / 2,
        final={"q": [0, 0, 0, 0.5**0.5, 0, 0, 0.5**0.5], "v": np.zeros(7)}, **m.start(),
    )  # fmt: skip
    torque = 3 * np.pi / 2 * 6 / 4 * (1 - found.t)
    assert abs(found.cost - 6 * (3 * np.pi / 2) ** 2 / 8) < 1e-6
    np.testing.assert_allclose(found.controls["torque"][:, 2], torque, atol=1e-5)
    assert found.solution.body("satellite").position.shape == (13, 3)


def test_time_is_least_with_the_force_at_its_bounds():
    sled = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2,
        force=lambda t, q, v, params: [params.F],
        q=("x",),
        params={"F": 0.0},
    )
    found = lv.optimal_control(
        sled, lv.Spark(2), controls=("F",), cost=lambda t, q, v, params: 1.0, t=(0, 3),
        final_time=(0.5, 10), bounds={"F": (-1, 1)}, steps=10, q=[0], v=[0],
        final={"q": [1], "v": [0]},
    )  # fmt: skip
    assert abs(found.t[-1] - 2) < 1e-8
    assert (np.abs(found.controls["F"]) == 1).all()


def test_bounds_hold_and_cost(swung):
    reach = np.abs(swung.q[:, 0]).max()
    bounds = {"F": (None, 0.9 * swung.stage_controls["F"].max()), "q": {"X": (-2, 0.95 * reach)}}
    found = swing(2, 48, bounds=bounds, guess=swung)
    assert found.stage_controls["F"].max() <= bounds["F"][1]
    assert found.q[:, 0].max() <= 0.95 * reach
    assert found.cost > swung.cost


def test_hamiltonians_and_structures_have_the_optimum_of_the_lagrangian(swung):
    hamiltonian = lv.Hamiltonian(
        lambda t, q, p, params: p[0] ** 2 / 2 + p[1] ** 2 + p[2] ** 2 + q[2] / 2,
        rod,
        force=lambda t, q, p, params: [params.F, 0, 0],
        q=("X", "x", "y"),
        params={"F": 0.0, "l": 1.0},
    )
    given = {
        "controls": ("F",), "cost": lambda t, q, p, params: params.F**2 / 2, "t": (0, 3),
        "steps": 20, "q": [0, 0, -1], "p": [0, 0, 0], "final": {"q": [0, 0, 1], "p": [0, 0, 0]},
        "guess": swung,
    }  # fmt: skip
    found, wanted = lv.optimal_control(hamiltonian, lv.Spark(2), **given), swing(2, 20, guess=swung)
    assert abs(found.cost - wanted.cost) < 1e-9
    np.testing.assert_allclose(found.costates["p"], wanted.costates["p"], atol=1e-8)
    stiffness, damping = np.array([[2.0, -1.0], [-1.0, 1.0]]), np.diag([0.1, 0.2])
    structure = lv.Structure(
        np.ones(2), stiffness, damping=damping, params={"F": 0.0},
        force=lambda t, q, v, params: [0, params.F],
    )  # fmt: skip
    springs = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - ca.dot(q, ca.mtimes(stiffness, q)) / 2,
        force=lambda t, q, v, params: ca.vertcat(0, params.F) - ca.mtimes(damping, v),
        q=2,
        params={"F": 0.0},
    )
    given = {"q": [0, 0], "v": [0, 0], "final": {"q": [0, 1], "v": [0, 0]}, "guess": None}
    costs = [swing(2, 10, x, **given).cost for x in (structure, springs)]
    assert abs(costs[0] / costs[1] - 1) < 1e-12


def test_redundant_constraints_change_nothing(swung):
    doubled = lv.Lagrangian(
        lagrangian,
        lambda t, q, params: (
            rod(t, q, params) | {"again": ca.sqrt((q[1] - q[0]) ** 2 + q[2] ** 2) - params.l}
        ),
        force=lambda t, q, v, params: [params.F, 0, 0],
        q=("X", "x", "y"),
        params={"F": 0.0, "l": 1.0},
    )
    found, wanted = (swing(1, 40, x, guess=swung) for x in (doubled, CART))
    assert abs(found.cost - wanted.cost) < 1e-9
    np.testing.assert_allclose(found.lam.sum(axis=1), wanted.lam[:, 0], atol=1e-9)


def test_the_program_grows_with_its_steps_only(general):
    from liouville._studies.optimal.arguments import Times
    from liouville._studies.optimal.problem import Problem

    def entries(steps):
        times = Times.of((0, 3), None, steps, None)
        given = {"q": [0, 0, -1], "v": [0, 0, 0]}
        problem = Problem(
            CART, lv.Spark(2), ("F",), effort, None, times, UPRIGHT, None, None, (), None, given
        )
        program = problem.transcription.program
        return np.array([program._jacobian.nnz_out(1), program._hessian.nnz_out(0)])

    np.testing.assert_array_equal(entries(30) - entries(20), entries(20) - entries(10))


REFUSED = {
    "a name alone": ({"controls": "F"}, TypeError, r"write controls=\('F',\)"),
    "no parameter": ({"controls": ("G",)}, ValueError, "'G' is no parameter"),
    "in a constraint": ({"controls": ("l",)}, ValueError, "'l' is in a constraint"),
    "in no force": ({"controls": ("F", "idle")}, ValueError, "'idle' is in no force"),
    "no cost": ({"cost": None}, TypeError, "needs cost or final_cost"),
    "a cost of two": ({"cost": lambda t, q, v, params: [1, 2]}, ValueError, "must return a scalar"),
    "a control at the end": ({"final_cost": effort}, ValueError, "final_cost depends on control"),
    "off the start": ({"q": [0, 0, -1.1]}, ValueError, "start violates the constraint 'rod'"),
    "off the end": ({"final": {"q": [0, 0, 1.1]}}, ValueError, "final state violates"),
    "repeated": ({"final": {"q": {"x": 1, "X": 0, "y": 0}}}, ValueError, "repeats what"),
    "too many": (
        {"final": UPRIGHT | {"more": lambda t, q, v, params: q[0]}},
        ValueError,
        "5 independent conditions, and constraints leave 2 positions and 2 velocities",
    ),
    "velocities alone": ({"final": {"v": [1, 0, 0]}}, ValueError, "all of v, and not all of q"),
    "bounds": ({"bounds": {"F": (2, 1)}}, ValueError, "leave nothing"),
    "a bound of none": ({"bounds": {"G": (1, 2)}}, ValueError, "no use for 'G'"),
    "a guess": (
        {"guess": {"t": [0, 1, 3], "F": [1, 2]}},
        ValueError,
        "F of the guess must have shape",
    ),
    "times": ({"final_time": (4, 5)}, ValueError, "must be limits around"),
    "an option": ({"options": {"no": 1}}, ValueError, "No such IPOPT option"),
    "a kind of option": ({"options": {"max_iter": "a"}}, ValueError, "options: type mismatch"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_wrong_is_refused_by_its_name(case):
    given, kind, sentence = REFUSED[case]
    with pytest.raises(kind, match=sentence):
        swing(**given)


def test_a_mass_without_constraints():
    """A path of its own through what is refused: nothing is eliminated, and nothing need move."""
    car = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v),
        force=lambda t, q, v, params: [params.F],
        q=("x",),
        params={"F": 0.0},
    )
    call = {"controls": ("F",), "cost": effort, "t": (0, 2), "steps": 4, "q": [0], "v": [0]}
    there = {"q": [1], "v": [0]}
    found = lv.optimal_control(car, lv.Spark(2), final=there, **call)
    # 6 (m d)^2 / T^3: the force is linear in time
    assert found.cost == pytest.approx(3.0, rel=1e-12)
    still = lv.optimal_control(car, lv.Spark(2), **call)
    assert not still.q.any()
    assert still.cost == 0
    for condition, says in (
        (lambda t, q, v, params: q[0] - 1, "'own' repeats what all of q fix already"),
        (lambda t, q, v, params: t - 1, "'own' fixes nothing"),
    ):
        final = {"own": condition} | ({"q": [1]} if "repeats" in says else {})
        with pytest.raises(ValueError, match=says):
            lv.optimal_control(car, lv.Spark(2), final=final, **call)


CAR = {
    "system": lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2,
        force=lambda t, q, v, params: [params.F],
        q=("x",),
        params={"F": 0.0},
    ),
    "controls": ("F",), "t": (0, 1), "q": [0], "v": [0], "final": {"q": [1], "v": [0]},
}  # fmt: skip


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_a_constant_cost_asks_for_any_motion_between_the_ends(value):
    """Its gradient has no entries, and IPOPT is given zeros."""
    found = lv.optimal_control(
        method=lv.Spark(2), cost=lambda t, q, v, params: value, steps=4, **CAR
    )
    assert found.cost == pytest.approx(value, abs=1e-12)
    assert found.solution.q[-1] == pytest.approx(1, abs=1e-12)
    assert np.abs(found.costates["p"]).max() < 1e-9


def test_a_whole_final_state_on_moving_constraints_is_that_of_one_time():
    """With a free end the state is on the constraints of no one time, and is refused."""
    moving = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - q[1],
        lambda t, q, params: {"rod": (q[0] - 0.3 * ca.sin(t)) ** 2 + q[1] ** 2 - 1},
        force=lambda t, q, v, params: [params.F, 0],
        q=("x", "y"),
        params={"F": 0.0},
    )
    start = moving.consistent(q=[0, -1], v=[0.3, 0])
    there = moving.consistent(t=2.0, q=[0.9, -0.5], v=[0, 0])
    call = {"controls": ("F",), "cost": lambda t, q, v, params: 1 + params.F**2 / 2}
    call |= {"t": (0, 2), "steps": 10, **start}
    found = lv.optimal_control(moving, lv.Spark(2), final=there, final_time=(2, 2), **call)
    np.testing.assert_allclose(found.q[-1], there["q"], rtol=0, atol=1e-12)
    sentence = r"final state violates the constraint 'rod'.* at t = 1.*\nhint: constraints move"
    with pytest.raises(ValueError, match=sentence):
        lv.optimal_control(moving, lv.Spark(2), final=there, final_time=(1, 4), **call)


@pytest.mark.parametrize("steps", [4, 10, 40])
def test_a_bound_that_no_motion_meets_is_named(steps):
    """A mean velocity of 1 is wanted with at most 0.5."""
    sentence = "without bounds v of 'x' goes to 1.[45].*, beyond its bound of 0.5"
    with pytest.raises(lv.OptimizationError, match=sentence) as none:
        lv.optimal_control(
            method=lv.Spark(2), cost=effort, **CAR, bounds={"v": (None, 0.5)}, steps=steps
        )
    assert none.value.status == "Infeasible_Problem_Detected"


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_bounds_of_states_hold_at_stages_and_leave_the_closed_optimum(stages):
    """The velocity rises as a parabola to its bound V, stays there for a while, and falls."""
    V = 1.2
    rise = 1.5 * (1 - 1 / V)
    wanted = 4 * V**2 / (3 * rise)
    off = []
    for steps in (20, 40):
        call = {"method": lv.Spark(stages), "cost": effort, "steps": steps, **CAR}
        found = lv.optimal_control(bounds={"v": {"x": (None, V)}}, **call)
        assert found.solution(found.stage_t.ravel()).v.max() < V + 1e-6
        off.append(abs(found.cost / wanted - 1))
    assert off[0] < (0.011 if stages == 1 else 1e-7)
    assert off[1] < (0.0026 if stages == 1 else 1e-7)


def test_bounds_of_positions_hold_at_stages():
    """Thrown at a wall at l and back in the same time: Bryson's least effort, l over 1/6."""
    for least, most, call in ((0, 0.2, {"v": [1], "final": {"q": [0], "v": [-1]}}),):
        found = lv.optimal_control(
            method=lv.Spark(2), cost=effort, steps=12, bounds={"q": {"x": (least, most)}},
            **(CAR | call),
        )  # fmt: skip
        assert found.solution(found.stage_t.ravel()).q.max() <= most + 1e-9
        assert found.cost == pytest.approx(2 + 6 * (1 - 4 * most) ** 2, rel=1e-8)
    tight = lv.optimal_control(
        method=lv.Spark(3), cost=effort, steps=24, bounds={"q": {"x": (None, 1 / 8)}},
        **(CAR | {"v": [1], "final": {"q": [0], "v": [-1]}}),
    )  # fmt: skip
    assert tight.solution(tight.stage_t.ravel()).q.max() <= 1 / 8 + 1e-9
    assert tight.cost == pytest.approx(4 / 9 * 8, rel=1e-3)


@pytest.mark.parametrize(("more", "sentence"), [
    ({"final": {"there": lambda t, q, v, params: (q[0] - 1) ** 2}},
     "final condition 'there' is met where its gradient vanishes"),
    ({"cost": lambda t, q, v, params: ca.fabs(params.F)},
     "its equations hold, and its cost may not be the least.*\nhint: look for kinks"),
    ({"method": lv.Spark(1), "steps": 1},
     "4 unknowns of the steps cannot meet 5 conditions.*\nhint: take more steps"),
    ({"options": {"max_wall_time": 1e-9}}, r"found yet.*\n.*raise options=.'max_wall_time'"),
])  # fmt: skip
def test_an_error_names_its_cause(more, sentence):
    call = {"method": lv.Spark(2), "cost": effort, "steps": 4, **CAR, **more}
    with pytest.raises(lv.OptimizationError, match=sentence):
        lv.optimal_control(**call)


def test_methods_and_systems_without_an_adjoint_of_their_own_are_refused():
    with pytest.raises(ValueError, match="takes Gauss points"):
        lv.optimal_control(CART, lv.Spark(2, points="radau"), controls=("F",), t=(0, 1), steps=1)
    named = lv.optimal_control(method="auto", cost=effort, steps=4, **CAR)
    assert named.cost == lv.optimal_control(method=lv.Spark(3), cost=effort, steps=4, **CAR).cost
    with pytest.raises(TypeError, match="not of HHT"):
        lv.optimal_control(CART, "hht", controls=("F",), t=(0, 1), steps=1)
    with pytest.raises(TypeError, match="not of HHT"):
        lv.optimal_control(CART, lv.HHT(), controls=("F",), t=(0, 1), steps=1)
    from liouville.problems import knife_edge

    with pytest.raises(TypeError, match="holonomic constraints"):
        lv.optimal_control(knife_edge.system, lv.Spark(1), controls=("F",), t=(0, 1), steps=1)


def test_an_error_says_what_is_missing_and_the_next_attempt_begins_there(swung):
    with pytest.raises(lv.OptimizationError, match="no optimum is found yet") as stopped:
        swing(3, 48, options={"max_iter": 8})
    assert stopped.value.iterations == 8
    found = swing(3, 48, guess=stopped.value.result)
    assert abs(found.cost - swung.cost) < 1e-9
    straight = {"q": [[0, 0, -1], [0, 0, 1]], "v": [[0, 0, 2 / 3]] * 2}
    with pytest.raises(lv.OptimizationError, match="leaps in step"):  # through its hinge
        swing(3, 20, guess=straight)
    with pytest.raises(lv.OptimizationError, match="off") as none:
        swing(1, 20, bounds={"F": (-0.1, 0.1)}, guess=None)
    assert none.value.status == "Infeasible_Problem_Detected"


@pytest.mark.parametrize(
    ("length", "time", "mass"), [(1e-9, 1e-6, 1e-15), (1e6, 1e3, 1e4), (1e11, 1e7, 1e24)]
)
@pytest.mark.parametrize("form", ["Lagrangian", "Hamiltonian"])
def test_units_do_not_matter(form, length, time, mass):
    """A body is moved from rest to rest by the least square of its force."""
    energies = {
        "Lagrangian": lambda t, q, v, params: mass * v[0] ** 2 / 2,
        "Hamiltonian": lambda t, q, p, params: p[0] ** 2 / (2 * mass),
    }
    more = {"force": lambda *args: [args[-1].F], "q": ("x",), "params": {"F": 0.0}}
    system = getattr(lv, form)(energies[form], **more)
    rate = {"Lagrangian": "v", "Hamiltonian": "p"}[form]
    found = lv.optimal_control(
        system, lv.Spark(2), controls=("F",), cost=lambda *args: args[-1].F ** 2 / 2,
        t=(0, time), steps=10, final={"q": [length], rate: [0]}, **{"q": [0], rate: [0]},
    )  # fmt: skip
    force = mass * length / time**2
    assert found.cost / (force**2 * time) == pytest.approx(6, rel=1e-9)
    assert found.controls["F"] / force == pytest.approx(6 - 12 * found.t / time, abs=1e-8)
    # the costate of the position is constant, and that of the momentum is minus the force
    assert found.costates["q"][:, 0] / (force**2 * time / length) == pytest.approx(-12, rel=1e-8)
    assert found.costates["p"][:, 0] == pytest.approx(-found.controls["F"], abs=1e-8 * force)


class InterruptedSolver:
    """A solver to which Ctrl-C comes while IPOPT runs."""

    def __init__(self, pressing, *given):
        self.pressing, self.solver = pressing, ca.nlpsol(*given)
        self.stats = self.solver.stats

    def __call__(self, **given):
        with self.pressing(0.05):
            return self.solver(**given)


def test_ctrl_c_interrupts_ipopt(monkeypatch, pressing):
    """It is no failure of the problem, which a caller might go on from."""
    interrupted = partial(InterruptedSolver, pressing)
    monkeypatch.setattr(program.ca, "nlpsol", interrupted, raising=False)
    with pytest.raises(KeyboardInterrupt, match="interrupted after"):
        swing(3, 300, bounds={"F": (-20, 20)})
    monkeypatch.undo()
    assert swing(2, 10).status == "Solve_Succeeded"


@pytest.mark.parametrize("scale", [lambda t: 1.0, lambda t: t, lambda t: 1 / t], ids="1th")
def test_a_final_position_is_held_as_near_whatever_time_does_to_the_size_of_its_constraint(scale):
    """By gradients at t = 0 the opposite point of the circle would be near enough."""
    bead = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        lambda t, q, params: {"rod": scale(t) * (ca.dot(q, q) - 1)},
        force=lambda t, q, v, params: [-params.F * q[1], params.F * q[0]],
        q=("x", "y"),
        params={"F": 0.0},
    )
    angles = -np.pi / 2 * np.linspace(0, 1, 21)
    with pytest.raises(lv.OptimizationError, match="no motion meets all conditions"):
        lv.optimal_control(
            bead, lv.Spark(2), controls=("F",), cost=effort, t=(10, 12), steps=20, q=[1, 0],
            v=[0, 0], final={"q": [0, 1], "v": [0, 0]},
            guess={"q": np.stack([np.cos(angles), np.sin(angles)], axis=1)},
        )  # fmt: skip
