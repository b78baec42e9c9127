"""Steps of a run's own choice: by estimated errors, and by a monitor, reversibly."""

import casadi as ca
import numpy as np
import pytest
from registry import PROBLEMS

import liouville as lv
from liouville.analysis.convergence import distance
from liouville.problems import kepler_on_sphere as kepler
from liouville.problems import load

#: Acceleration-level solves that the library's own monitor takes at each step.
SOLVES = 7


def near(t, q, v, params):
    """Return r^(3/2), r the distance from the axis through the pole."""
    return (q[0] ** 2 + q[1] ** 2) ** 0.75


def orbit(method, periods, **options):
    span = (0.0, periods * kepler.period)
    return lv.integrate(kepler.system, method, t=span, **kepler.start, **options)


def cost(found):
    """Return the number of evaluations of the forces, those of the monitor with them."""
    own = "h" in found.tolerances
    return found.stats["evaluations"] + (SOLVES * found.stats["steps"] if own else 0)


def moved(found):
    """Return by how much the mean energy of the last orbit differs from that of the first."""
    energy, middle = found.invariants["energy"], kepler.period / 2
    first = energy[np.abs(found.t - middle) < middle]
    last = energy[np.abs(found.t - found.t[-1] + middle) < middle]
    return abs(last.mean() - first.mean())


# errors


@pytest.mark.parametrize("method", [lv.Spark(2), lv.Spark(3), lv.Spark(4), lv.LobattoPair(4)])
@pytest.mark.parametrize("name", ["pendulum", "car_axis", "andrews", "heavy_top"])
def test_a_step_adds_about_the_tolerance(method, name):
    """Measured by a method of order 12 from each of some states on; in the tolerance's own norm."""
    problem, rtol = load(name), 1e-8
    t0, t1 = problem.interval
    span = (t0, t0 + min(3.0, t1 - t0))
    found = lv.integrate(problem.system, method, t=span, rtol=rtol, **problem.start)
    ratios = []
    for k in np.linspace(len(found.t) // 3, len(found.t) - 2, 12).astype(int):
        start, ends = {"q": found.q[k], "v": found.v[k]}, (found.t[k], found.t[k + 1])
        one = lv.integrate(problem.system, method, t=ends, steps=1, **start)
        exact = lv.integrate(problem.system, lv.Spark(6), t=ends, steps=6, **start)
        unit = rtol * (np.maximum(np.abs(found.q[k]), np.abs(found.q[k + 1])) + 1e-3)
        ratios.append(np.sqrt(np.mean(((one.q[-1] - exact.q[-1]) / unit) ** 2)))
    assert 1e-4 < np.median(ratios) < 1
    assert max(ratios) < 20


def ringing():
    """Return a heavy oscillator with a fast one on it, which a force from zero on sets ringing."""
    system = lv.Lagrangian(
        lambda t, q, v, params: (ca.dot(v, v) - q[0] ** 2 - 1e6 * (q[1] - q[0]) ** 2) / 2,
        q=2,
        force=lambda t, q, v, params: ca.vertcat(0.0, -100 * v[1] + 100 * ca.sin(3 * t)),
    )
    return system, {"q": [1.0, 1.0], "v": [0.0, 0.0]}, 1.0


def rubbing():
    """Return a block on a spring with friction that turns within a thousandth of its speed."""
    system = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - 50 * q[0] ** 2,
        q=1,
        force=lambda t, q, v, params: [-0.3 * ca.tanh(v[0] / 1e-3)],
    )
    return system, {"q": [0.1], "v": [0.3]}, 2.0


def far():
    """Return a damped oscillator a hundred amplitudes away from the origin."""
    system = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - (q[0] - 100) ** 2) / 2,
        q=1,
        force=lambda t, q, v, params: -0.01 * v,
    )
    return system, {"q": [101.0], "v": [0.0]}, 10.0


@pytest.mark.parametrize(
    ("motion", "rtol", "most"),
    [(ringing, 1e-6, 3e-5), (rubbing, 1e-6, 3e-5), (rubbing, 1e-8, 1e-7), (far, 1e-8, 2e-7)],
)
def test_velocities_are_held_to_the_tolerance_too(motion, rtol, most):
    """Positions alone, held to it, leave velocities off by up to 2e-3."""
    system, start, end = motion()
    times = {"t": (0, end), "t_eval": np.linspace(0, end, 21), **start}
    found = lv.integrate(system, lv.Spark(3), rtol=rtol, **times)
    exact = lv.integrate(system, lv.Spark(3), h=end / 40000, **times)
    assert np.abs(found.v - exact.v).max() < most * np.abs(exact.v).max()


@pytest.mark.parametrize("method", [lv.Spark(2), lv.Spark(3), lv.LobattoPair(3)], ids=str)
@pytest.mark.parametrize("name", ["pendulum", "double_pendulum", "moving_wire"])
def test_the_error_falls_with_the_tolerance(method, name):
    """A local error of order p + 1 at the tolerance leaves a global one of its power p/(p + 1)."""
    problem, tolerances = load(name), 10.0 ** -np.arange(4, 11)
    t = 0.0, min(2.0, problem.interval[1])
    exact = lv.integrate(problem.system, lv.Spark(6), t=t, h=problem.h / 2, **problem.start).q[-1]
    errors = [
        distance(lv.integrate(problem.system, method, t=t, rtol=rtol, **problem.start).q[-1], exact)
        for rtol in tolerances
    ]
    slope = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert 0.55 < slope < 1.25, errors
    assert errors[-1] < 1e-7


@pytest.mark.parametrize("stages", range(1, 7))
def test_the_pendulum_that_starts_level_and_at_rest_keeps_its_energy(stages):
    """Three of the first four Taylor coefficients of its motion vanish.

    What the steps may add to the energy is the tolerance, and they may all add it. A controller
    that trusts the third coefficient finds that any step will do.
    """
    problem = load("pendulum")
    for rtol in 10.0 ** -np.arange(2, 14 if stages > 1 else 8):
        found = lv.integrate(problem.system, lv.Spark(stages), t=(0, 5), rtol=rtol, **problem.start)
        error = np.abs(found.invariants["energy"] - found.invariants["energy"][0]) / 9.81
        assert error.max() < rtol * found.stats["steps"]
        assert np.abs(np.diff(error)).max() < 40 * rtol
        ratios = found.t[2:-1] - found.t[1:-2]
        assert (ratios / np.diff(found.t)[:-2]).max() < 4.01
    naive = lv.integrate(problem.system, lv.Spark(stages), t=(0, 0.3), steps=1, **problem.start)
    third = np.zeros(2)  # y''' of (cos f, sin f), f'' = -g cos f, f = f' = 0
    assert not third.any()
    assert np.abs(naive.invariants["energy"] - naive.invariants["energy"][0])[-1] > 40 * 9.81 * rtol


@pytest.mark.parametrize("power", [1, 1.5])
@pytest.mark.parametrize("stages", [2, 3, 5, 8])
def test_a_step_does_not_end_deep_in_a_contact_that_no_stage_meets(stages, power):
    """A ball falls on a stiff spring, which multiplied its energy by six at any tolerance."""
    stiff = 1e5 if power == 1 else 1e6
    ball = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - 9.81 * q[0],
        force=lambda t, q, v, params: stiff * ca.fmax(0, -q[0]) ** power,
        q=("height",),
    )
    for rtol in 10.0 ** -np.arange(4, 11):
        found = lv.integrate(ball, lv.Spark(stages), t=(0, 2), rtol=rtol, q=[1.0], v=[0.0])
        pressed = np.maximum(0, -found.q[:, 0]) ** (power + 1)
        energy = found.v[:, 0] ** 2 / 2 + 9.81 * found.q[:, 0] + stiff * pressed / (power + 1)
        assert np.abs(energy / 9.81 - 1).max() < 20 * np.sqrt(rtol)
        assert found.stats["steps"] + found.stats["rejected"] < 600


@pytest.mark.parametrize("rtol", [1e-7, 1e-9])
def test_a_rejected_step_is_undone(rtol):
    """A kick that comes from nowhere costs rejections and leaves the error where it was."""
    kicked = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - ca.dot(q, q) / 2,
        q=1,
        force=lambda t, q, v, params: 100 * ca.exp(-(((t - 5) / 0.02) ** 2)),
    )
    start = {"q": [1.0], "v": [0.0]}
    found = lv.integrate(kicked, lv.Spark(3), t=(0, 10), rtol=rtol, **start)
    exact = lv.integrate(kicked, lv.Spark(4), t=(0, 10), h=1e-3, **start)
    assert found.stats["rejected"] >= 1
    assert found.stats["h_smallest"] == pytest.approx(np.diff(found.t).min(), rel=1e-9)
    assert found.stats["h_largest"] == pytest.approx(np.diff(found.t).max(), rel=1e-9)
    assert abs(found.q[-1, 0] - exact.q[-1, 0]) < 300 * rtol


@pytest.mark.parametrize("name", ["moving wire", "breathing sphere", "nonlinear reaction"])
def test_forces_that_are_not_conservative_forth_and_back(name):
    problem = PROBLEMS[name]
    first = next(iter(problem.start))
    exact = lv.integrate(problem.system, lv.Spark(6), t=problem.t, steps=400, **problem.start)
    found = lv.integrate(problem.system, lv.Spark(3), t=problem.t, rtol=1e-9, **problem.start)
    assert distance(found.states[first][-1], exact.states[first][-1]) < 1e-7
    back = {key: found.states[key][-1] for key in problem.start}
    again = lv.integrate(problem.system, lv.Spark(3), t=problem.t[::-1], rtol=1e-9, **back)
    assert np.all(np.diff(again.t) < 0)
    assert distance(again.states[first][-1], np.asarray(problem.start[first])) < 1e-7


def test_where_no_step_will_do_the_run_ends():
    wall = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2,
        q=1,
        force=lambda t, q, v, params: 1 / (1 - q[0]) ** 3,
    )
    with pytest.raises(lv.IntegrationError, match="less than h_min") as caught:
        lv.integrate(
            wall, lv.Spark(3), t=(0, 10), rtol=1e-6, control=lv.Adaptive(1e-5), q=[0.0], v=[1.0]
        )
    assert caught.value.t < 1
    assert np.diff(caught.value.solution.t).min() >= 1e-5 * (1 - 1e-9)


# reversible steps


@pytest.mark.parametrize(("monitor", "h", "rtol"), [(None, 0.092, 1e-10), (near, 0.07, 1e-9)])
def test_reversible_steps_hold_the_energy_that_controlled_ones_lose(monitor, h, rtol):
    """Fifty orbits, at fewer evaluations than either of the others, all solved to roundoff.

    As many equal steps do not get through the first orbit.
    """
    method, periods = lv.Spark(3), 50
    found = orbit(method, periods, h=h, control=lv.Reversible(monitor))
    controlled = orbit(lv.Spark(3, newton_tol=1e-19), periods, rtol=rtol)
    equal = orbit(method, periods, steps=800 * periods)
    assert cost(found) < cost(controlled)
    assert cost(found) < cost(equal) / 2
    assert 50 * moved(found) < moved(controlled)
    drift = found.invariant_drift("energy").max()
    assert drift < controlled.invariant_drift("energy").max()
    assert drift < equal.invariant_drift("energy").max() / 1000
    with pytest.raises(lv.IntegrationError):
        orbit(method, 1, steps=found.stats["steps"] // periods)


METHODS = [
    lv.Spark(1),
    lv.Spark(3),
    lv.LobattoPair(2),
    lv.LobattoPair(3),
    lv.Composition(lv.Spark(1), "SU4"),
]


@pytest.mark.parametrize("monitor", [None, near], ids=["own", "given"])
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_turned_round_they_go_back(method, monitor):
    """With the velocities turned, the same steps lead back to the start, to roundoff."""
    h = 0.004 if method.order == 2 else 0.02
    options = {"control": lv.Reversible(monitor)}
    there = orbit(method, 0.8, h=h, **options)
    end = there.t[-2]  # the last step was made to fit
    there = lv.integrate(kepler.system, method, t=(0, end), h=h, **kepler.start, **options)
    start = {"q": there.q[-1], "v": -there.v[-1], "h": there.stats["h_next"]}
    back = lv.integrate(kepler.system, method, t=(0, end), **start, **options)
    assert len(back.t) == len(there.t)
    limit = 1e-12 if monitor else 1e-6  # of differences of differences
    np.testing.assert_allclose(end - back.t[::-1], there.t, rtol=0, atol=limit)
    np.testing.assert_allclose(back.q[-1], there.q[0], rtol=0, atol=limit)
    np.testing.assert_allclose(-back.v[-1], there.v[0], rtol=0, atol=10 * limit)
    in_time = {"q": there.q[-1], "v": there.v[-1], "h": there.stats["h_next"]}
    back = lv.integrate(kepler.system, method, t=(end, 0), **in_time, **options)
    np.testing.assert_allclose(back.q[-1], there.q[0], rtol=0, atol=limit)


def test_a_run_goes_on_with_its_last_step():
    options = {"control": lv.Reversible(near)}
    whole = orbit(lv.Spark(3), 1.0, h=0.05, **options)
    k = len(whole.t) // 2
    first = lv.integrate(
        kepler.system, lv.Spark(3), t=(0, whole.t[k]), h=0.05, **kepler.start, **options
    )
    start = {"q": first.q[-1], "v": first.v[-1], "h": first.stats["h_next"]}
    rest = lv.integrate(
        kepler.system, lv.Spark(3), t=(first.t[-1], kepler.period), **start, **options
    )
    np.testing.assert_allclose(rest.t, whole.t[k:], rtol=0, atol=1e-12)


def moving(t, y, z, params):
    return (2 + ca.sin(t)) / (1 + ca.dot(z, z))


@pytest.mark.parametrize("form", [lv.Lagrangian, lv.Hamiltonian])
def test_steps_follow_a_monitor_of_time_and_velocity(form):
    """Its rate along the motion has parts of t and of the acceleration."""
    well = {
        lv.Lagrangian: lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2,
        lv.Hamiltonian: lambda t, q, p, params: (p[0] ** 2 + q[0] ** 2) / 2,
    }[form]
    start = {"q": [1.0], ("v" if form is lv.Lagrangian else "p"): [0.0]}
    found = lv.integrate(
        form(well, q=1),
        lv.Spark(2),
        t=(0, 10),
        h=0.01,
        control=lv.Reversible(moving),
        **start,
    )
    wanted = 0.01 * (2 + np.sin(found.t)) / (1 + found.v[:, 0] ** 2) / 2
    middle = (wanted[1:-1] + wanted[:-2]) / 2
    np.testing.assert_allclose(np.diff(found.t)[:-1], middle, rtol=2e-3)
    assert found.h == pytest.approx(10 / found.stats["steps"])
    assert found.tolerances == {"h": 0.01}


def test_a_monitor_that_is_constant_gives_equal_steps():
    """To the bit; and 20 000 summed times are those that are computed."""
    problem = load("spherical_pendulum")
    options = {"control": lv.Reversible(lambda t, q, v, params: 3.0)}
    equal = lv.integrate(problem.system, lv.Spark(2), t=(0, 4), h=1 / 64, **problem.start)
    found = lv.integrate(
        problem.system, lv.Spark(2), t=(0, 4), h=1 / 64, **problem.start, **options
    )
    for name, states in equal.states.items():
        np.testing.assert_array_equal(states, found.states[name])
    well = lv.Lagrangian(lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2, q=1)
    long = lv.integrate(
        well, lv.Spark(1), t=(0, 2e3 + 0.05), h=0.1, q=[1.0], v=[0.0], states=False, **options
    )
    expected = np.arange(len(long.t) - 1) * 0.1
    np.testing.assert_array_less(np.abs(long.t[:-1] - expected), 1.5 * np.spacing(expected + 0.1))


def test_the_own_monitor_sees_time_scales_not_zeros():
    """An oscillation, whose acceleration vanishes twice a period, has nearly equal steps."""
    well = lv.Lagrangian(lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2, q=1)
    start = {"q": [0.3], "v": [1.0]}
    found = lv.integrate(well, lv.Spark(2), t=(0, 50), h=0.1, control=lv.Reversible(), **start)
    sizes = np.diff(found.t)[:-1]
    assert sizes.max() < 1.2 * sizes.min()


@pytest.mark.parametrize("value", ["zero", "negative", "not finite"])
def test_a_monitor_that_is_not_positive_says_when(value):
    shapes = {
        "zero": lambda t, q, v, params: ca.fmax(1 - t, 0),
        "negative": lambda t, q, v, params: 1 - t,
        "not finite": lambda t, q, v, params: ca.sqrt(1 - t),
    }
    with pytest.raises(lv.IntegrationError, match=r"monitor|h_min") as caught:
        orbit(lv.Spark(2), 1.0, h=0.05, control=lv.Reversible(shapes[value], h_min=0.04))
    assert 0 <= caught.value.t <= 1.05
    at_once = {"control": lv.Reversible(lambda t, q, v, params: -q[2])}
    with pytest.raises(lv.IntegrationError, match=r"the monitor is -0\.6 at t = 0") as caught:
        orbit(lv.Spark(2), 1.0, h=0.05, **at_once)
    assert caught.value.quantity == "monitor"


def test_reversible_steps_have_a_least_size_too():
    with pytest.raises(lv.IntegrationError, match="less than h_min") as caught:
        orbit(lv.Spark(3), 1.0, h=0.05, control=lv.Reversible(near, h_min=1e-2))
    assert 0 < caught.value.t < kepler.period / 2
    assert np.diff(caught.value.solution.t).min() >= 1e-2


def test_events_and_times_do_not_change_the_steps():
    options = {"h": 0.05, "control": lv.Reversible(near)}
    plain = orbit(lv.Spark(3), 2.0, **options)
    nearest = lv.Event(lambda t, q, v, lam, params: q[0] * v[0] + q[1] * v[1], direction="up")
    watched = orbit(lv.Spark(3), 2.0, events={"near": nearest}, **options)
    np.testing.assert_array_equal(plain.t, watched.t)
    np.testing.assert_array_equal(plain.q, watched.q)
    np.testing.assert_allclose(
        watched.events["near"].t, kepler.period * np.array([0.5, 1.5]), rtol=1e-5
    )


def test_events_part_dry_friction_into_smooth_pieces():
    """What no estimate sees, a jump of the force within a step, is met to the tolerance."""
    block = lv.Lagrangian(
        lambda t, q, v, p: (v[0] ** 2 - q[0] ** 2) / 2,
        force=lambda t, q, v, p: [0.3 * p.side],
        q=1,
        params={"side": 1.0},
    )
    turn = {"turn": lv.Event(lambda t, q, v, lam, p: v[0], terminal=True)}
    t, q, side = 0.0, [2.0], 1.0
    for swing in range(3):
        piece = lv.integrate(
            block, lv.Spark(3), t=(t, 9.0), rtol=1e-7, q=q, v=[0.0],
            params={"side": side}, events=turn,
        )  # fmt: skip
        t, q, side = piece.t[-1], piece.q[-1], -side
        # each swing is half a cosine about the place where spring and friction balance
        exact = 2 - 0.6 * (swing + 1) if swing < 2 else 0.3 + 0.5 * np.cos(9.0 - 2 * np.pi)
        assert abs(abs(q[0]) - abs(exact)) <= 1e-6
        assert abs(t - min((swing + 1) * np.pi, 9.0)) <= 1e-6


def test_controlled_steps_end_at_the_switches_of_a_system():
    """A narrow regularisation of dry friction, beside a large swing that carries the tolerance."""
    width = 1e-2

    def block(**more):
        return lv.Lagrangian(
            lambda t, q, v, params: (ca.dot(v, v) - q[0] ** 2 - 4 * q[1] ** 2) / 2,
            force=lambda t, q, v, params: [-0.3 * ca.tanh(v[0] / width), 0],
            q=2,
            **more,
        )

    edges = {
        f"edge {k}": lambda t, q, v, params, k=k: v[0] - k * width for k in (-8, -3, -1, 1, 3, 8)
    }
    call = {"t": (0, 5), "q": [2.0, 100.0], "v": [0.3, 0.0]}
    exact = lv.integrate(block(), lv.Spark(4), steps=6000, every=6000, **call).q[-1, 0]
    blind = lv.integrate(block(), lv.Spark(3), rtol=1e-5, **call)
    seeing = lv.integrate(block(switches=edges), lv.Spark(3), rtol=1e-5, **call)
    assert abs(blind.q[-1, 0] - exact) > 5e-6
    assert abs(seeing.q[-1, 0] - exact) < 1e-6
    assert seeing.stats["steps"] < 85
    assert not seeing.events
    # each is the end of a step
    crossed = np.abs(seeing.v[:, 0, None] / width - np.array([-8, -3, -1, 1, 3, 8])).min(axis=0)
    assert crossed.max() < 1e-10
    np.testing.assert_allclose(
        lv.integrate(block(switches=edges), lv.Spark(3), rtol=1e-5, t_eval=[1.2, 4.1], **call).q,
        seeing([1.2, 4.1]).q,
        rtol=1e-9,
    )
    equal = [
        lv.integrate(block(**more), lv.Spark(3), h=0.1, **call)
        for more in ({}, {"switches": edges})
    ]
    np.testing.assert_array_equal(equal[0].q, equal[1].q)


@pytest.mark.parametrize("length", [1.0, 1e-9])
def test_an_absolute_tolerance_that_outweighs_all_coordinates_gets_a_word(length, tmp_path):
    pendulum = lv.Lagrangian(
        lambda t, q, v, p: ca.dot(v, v) / 2 - 9.81 * length * q[1],
        lambda t, q, p: (ca.sumsqr(q) / length**2 - 1) / 2,
        q=2,
    )
    call = {"t": (0, 1), "rtol": 1e-8, "q": [length, 0], "v": [0, 0]}
    run = lv.integrate(pendulum, lv.Spark(3), **call)
    told = "the errors are judged by atol = rtol / 1000 = 1e-11, which is more than rtol times"
    assert run.message.startswith(told) == (length < 1)
    assert bool(run.message) == (length < 1)
    stored = lv.integrate(pendulum, lv.Spark(3), **call, store=tmp_path / "run.zarr")
    assert stored.message == run.message
    given = lv.integrate(pendulum, lv.Spark(3), atol=1e-11 * length, **call)
    assert given.message == ""
    assert given.stats["steps"] > 20
