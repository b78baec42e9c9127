"""Models of SymPy's mechanics: those of its documentation, against its own equations."""

import sys

import casadi as ca
import numpy as np
import pytest

import liouville as lv

sympy = pytest.importorskip("sympy")
me = pytest.importorskip("sympy.physics.mechanics")

T = me.dynamicsymbols._t
FOURBAR = {"l1": 0.5, "l2": 1.0, "l3": 0.9, "l4": 1.1, "rho": 2.0, "g": 9.81}
DISC = {"r": 0.4, "m": 2.0, "g": 9.81}


def fourbar(is_odd):
    """Return SymPy's linkage of three links, the last pinned to the ground, with gravity."""
    q, u = me.dynamicsymbols("q1:4"), me.dynamicsymbols("u1:4")
    lengths, rho, g = sympy.symbols("l1:5"), *sympy.symbols("rho g")
    rates = [x.diff(T) for x in q]
    kinematics = [a - b for a, b in zip(rates, u, strict=True)]
    if is_odd:
        kinematics[1:] = [
            rates[0] + rates[1] - u[1],
            (2 + sympy.cos(q[0])) * rates[2] + rates[1] - u[2],
        ]
    solved = sympy.solve(kinematics, rates)
    frame = me.ReferenceFrame("N")
    first = point = me.Point("P")
    first.set_vel(frame, 0)
    bodies, loads, energy, last, spin = [], [], 0, frame, 0
    for k in range(3):
        link = last.orientnew(f"L{k}", "Axis", (q[k], last.z))
        spin += solved[rates[k]]
        link.set_ang_vel(frame, spin * frame.z)
        centre, end = (
            point.locatenew(f"{x}{k}", part * lengths[k] * link.x)
            for x, part in (("c", sympy.Rational(1, 2)), ("e", 1))
        )
        centre.v2pt_theory(point, frame, link)
        end.v2pt_theory(point, frame, link)
        mass = rho * lengths[k]
        inertia = me.inertia(link, 0, 0, mass * lengths[k] ** 2 / 12)
        bodies.append(me.RigidBody(f"B{k}", centre, link, mass, (inertia, centre)))
        loads.append((centre, -mass * g * frame.y))
        energy += bodies[-1].kinetic_energy(frame) - mass * g * centre.pos_from(first).dot(frame.y)
        point, last = end, link
    loop = point.pos_from(first) - lengths[3] * frame.x
    closed = [loop.dot(frame.x), loop.dot(frame.y)]
    method = me.KanesMethod(
        frame,
        q[:1],
        u[:1],
        kd_eqs=kinematics,
        q_dependent=q[1:],
        configuration_constraints=closed,
        u_dependent=u[1:],
        velocity_constraints=[x.diff(T).subs(solved) for x in closed],
        bodies=bodies,
        forcelist=loads,
    )
    energy = energy.subs(dict(zip(u, rates, strict=True)))  # of speeds that are rates
    return method, me.LagrangesMethod(energy, q, hol_coneqs=closed)


def test_the_four_bar_linkage_is_the_same_by_every_method_and_choice_of_speeds():
    kane, lagrange = fourbar(is_odd=False)
    system = lv.from_sympy(lagrange, FOURBAR)
    assert isinstance(system, lv.Lagrangian)
    assert system.coordinates == ("q1", "q2", "q3")
    q = system.consistent(q=[1.0, -0.5, -2.2], v=[0, 0, 0])["q"]
    v = system.consistent(q=q, v=[6.0, -3, -3], hold="q")["v"]
    run = {"t": (0, 1), "h": 0.01}
    wanted = lv.integrate(system, lv.Spark(4), q=q, v=v, **run)
    energy = wanted.invariants["energy"]
    assert np.abs(energy - energy[0]).max() < 1e-6 * abs(energy[0])
    odd = [v[0], v[0] + v[1], (2 + np.cos(q[0])) * v[2] + v[1]]
    for method, u in ((kane, v), (fourbar(is_odd=True)[0], odd)):
        system = lv.from_sympy(method, FOURBAR)
        assert (len(system.constraints), system.nonholonomic) == (2, ())
        solution = lv.integrate(system, lv.Spark(4), y=q, z=u, **run)
        assert np.abs(solution.y - wanted.q).max() < 1e-12
        assert np.abs(solution.lam - wanted.lam).max() < 1e-9
        assert max(np.abs(x).max() for x in solution.residuals.values()) < 1e-13


def disc(slides, aux=False):
    """Return SymPy's rolling disc; `slides` where the point of contact has coordinates."""
    q, u = me.dynamicsymbols("q1:6"), me.dynamicsymbols("u1:6")
    pushed, forces = me.dynamicsymbols("u7:9"), me.dynamicsymbols("f1:3")
    r, m, g = sympy.symbols("r m g")
    frame = me.ReferenceFrame("N")
    yaw = frame.orientnew("Y", "Axis", (q[0], frame.z))
    lean = yaw.orientnew("L", "Axis", (q[1], yaw.x))
    rim = lean.orientnew("R", "Axis", (q[2], lean.y))
    turning = rim.ang_vel_in(frame)
    spin = u[0] * lean.x + u[1] * lean.y + u[2] * lean.z
    kinematics = [me.dot(turning - spin, x) for x in lean]
    rim.set_ang_vel(frame, spin)
    ground, contact = me.Point("O"), me.Point("C")
    ground.set_vel(frame, 0)
    contact.set_vel(frame, pushed[0] * yaw.x + pushed[1] * yaw.y if aux else 0)
    centre = contact.locatenew("D", r * lean.z)
    inertia = me.inertia(lean, m * r**2 / 4, m * r**2 / 2, m * r**2 / 4)
    if not slides:
        centre.v2pt_theory(contact, frame, rim)
    else:
        place = q[3] * frame.x + q[4] * frame.y + r * lean.z
        velocity = place.dt(frame).subs(sympy.solve(kinematics, [x.diff(T) for x in q[:3]]))
        velocity = velocity.subs({q[3].diff(T): u[3], q[4].diff(T): u[4]})
        centre.set_vel(frame, velocity)
        slip = velocity - me.cross(spin, r * lean.z)
        kinematics += [a.diff(T) - b for a, b in zip(q[3:], u[3:], strict=True)]
    body = me.RigidBody("B", centre, rim, m, (inertia, centre))
    loads = [(centre, -m * g * frame.z)]
    loads += [(contact, forces[0] * yaw.x + forces[1] * yaw.y)] * aux
    more = {"bodies": [body], "forcelist": loads, "kd_eqs": kinematics}
    if not slides:
        more |= {"u_auxiliary": pushed} if aux else {}
        return me.KanesMethod(frame, q[:3], u[:3], **more)
    rows = [slip.dot(frame.x), slip.dot(frame.y)]
    return me.KanesMethod(frame, q, u[:3], u_dependent=u[3:], velocity_constraints=rows, **more)


def accelerations(system, y, z):
    s, m = system.symbols, system.model
    right = m.f - ca.jtimes(m.p, s.y, m.v)
    found = ca.solve(ca.jacobian(m.p, s.z), right)
    function = ca.Function("a", [s.t, s.y, s.z, s.params.vector], [found])
    return np.array(function(0, y, z, system.values(None))).ravel()


@pytest.mark.parametrize("aux", [False, True])
def test_the_rolling_disc_has_the_accelerations_of_kanes_equations(aux):
    method = disc(slides=False, aux=aux)
    y, z = np.array([0.3, 0.4, 0.5]), np.array([0.7, -3.0, 1.1])
    found = accelerations(lv.from_sympy(method, DISC), y, z)  # before the equations are formed
    method.kanes_equations()
    values = dict(zip([*method.q, *method.u], [*y, *z], strict=True))
    values |= {sympy.Symbol(name): x for name, x in DISC.items()}
    mass, forcing = (
        np.array(x.subs(method.kindiffdict()).subs(values).evalf(), dtype=float)
        for x in (method.mass_matrix, method.forcing)
    )
    assert np.abs(np.linalg.solve(mass, forcing).ravel() - found).max() < 1e-13


def test_constraints_on_speeds_that_are_no_rates_roll_the_disc():
    y, z = [0.3, 0.4, 0.5], [0.7, -3.0, 1.1]
    run = {"t": (0, 1), "h": 0.02}
    wanted = lv.integrate(lv.from_sympy(disc(slides=False), DISC), lv.Spark(4), y=y, z=z, **run)
    system = lv.from_sympy(disc(slides=True), DISC)
    assert len(system.nonholonomic) == 2
    start = system.consistent(y=[*y, 0, 0], z=[*z, 0, 0], hold="y")
    z = [*z, *np.linalg.solve(slopes(system, start)[:, 3:], -slopes(system, start)[:, :3] @ z)]
    solution = lv.integrate(system, lv.Spark(4), y=start["y"], z=z, **run)
    assert np.abs(solution.y[:, :3] - wanted.y).max() < 1e-11
    assert solution.residuals["nonholonomic"].max() < 1e-13


def slopes(system, start):
    s, m = system.symbols, system.model
    rows = ca.jacobian(m.nonholonomic.k, s.z)
    function = ca.Function("k", [s.t, s.y, s.z, s.params.vector], [rows])
    return np.array(function(0, start["y"], start["z"], system.values(None)))


def hung():
    """Return a bar on a pin, by joints."""
    wall, bar = me.RigidBody("W"), me.RigidBody("P", mass=sympy.Symbol("m"))
    q, u = me.dynamicsymbols("q u")
    m, length, g, c = sympy.symbols("m l g c")
    bar.central_inertia = me.inertia(bar.frame, 0, 0, m * length**2 / 12)
    system = me.System.from_newtonian(wall)
    pin = me.PinJoint("J", wall, bar, q, u, child_point=-length / 2 * bar.x, joint_axis=wall.z)
    system.add_joints(pin)
    system.apply_uniform_gravity(-g * system.y)
    system.add_loads(me.Torque(bar, (me.dynamicsymbols("push") - c * u) * system.z))
    return system


def test_a_system_of_joints_takes_inputs():
    inputs = {"push": lambda t, q, u, params: params.c * u[0] + 2 * t}
    values = {sympy.Symbol("l"): 1.0, "m": 2.0, "g": 9.81, "c": 0.1}
    system = lv.from_sympy(hung(), values, inputs=inputs)
    assert (system.coordinates, system.params) == (("q",), {"l": 1, "m": 2, "g": 9.81, "c": 0.1})
    found = accelerations(system, [0.3], [0.2])
    assert abs(found[0] + 9.81 * np.cos(0.3) * 1.5) < 1e-14
    still = lv.integrate(system, lv.Spark(3), t=(0, 1), h=0.02, y=[0], z=[0], params={"g": 0.0})
    assert abs(still.y[-1, 0] - 1 / 3 / (2 / 3)) < 1e-12


def lagrange(term, **more):
    q = me.dynamicsymbols("q")
    return me.LagrangesMethod(q.diff(T) ** 2 / 2 + term(q), [q], **more)


def test_loads_and_constraints_on_velocities_of_lagranges_method():
    x, y = me.dynamicsymbols("x y")
    frame, point = me.ReferenceFrame("N"), me.Point("P")
    point.set_vel(frame, x.diff(T) * frame.x + y.diff(T) * frame.y)
    load = (point, -x.diff(T) * frame.x + sympy.sin(sympy.pi * T) * frame.y)
    energy = (x.diff(T) ** 2 + y.diff(T) ** 2) / 2
    method = me.LagrangesMethod(
        energy,
        [x, y],
        forcelist=[load],
        frame=frame,
        nonhol_coneqs=[y.diff(T) - x.diff(T)],
    )
    system = lv.from_sympy(method)
    solution = lv.integrate(system, lv.Spark(4), t=(0, 1), h=0.05, q=[0, 0], v=[0, 0])
    # 2 x'' = -x' + sin(pi t)
    w = np.pi
    rate = (np.sin(w) / 2 - w * np.cos(w) + w * np.exp(-0.5)) / 2 / (0.25 + w**2)
    assert abs(solution.v[-1, 0] - rate) < 1e-12


BAD = {
    "a model must be a LagrangesMethod, a KanesMethod or a System": lambda: lv.from_sympy(3),
    "parameters 'c', 'g', 'l' and 'm' have no value": lambda: lv.from_sympy(
        hung(), inputs={"push": lambda *x: 0}
    ),
    "a load has push(t), which is none of 'q' and 'u'\nhint: give it: inputs={'push'": (
        lambda: lv.from_sympy(hung(), {"c": 1, "g": 1, "l": 1, "m": 1})
    ),
    "the Lagrangian has besselj, which no model can have": lambda: lv.from_sympy(
        lagrange(lambda q: sympy.besselj(0, q))
    ),
    "the Lagrangian has Derivative(p(t), t), which is no rate of": lambda: lv.from_sympy(
        lagrange(lambda q: me.dynamicsymbols("p", 1) * q)
    ),
    "parameter 'k' has no value\nhint: give params={'k': ...}": lambda: lv.from_sympy(
        lagrange(lambda q: sympy.Symbol("k") * q)
    ),
    "no inertial frame that they are of: frame=": lambda: lv.from_sympy(
        lagrange(lambda q: q, forcelist=[(me.Point("P"), me.ReferenceFrame("N").x)])
    ),
    "the bodies of the method are not known": lambda: lv.from_sympy(
        me.KanesMethod(
            me.ReferenceFrame("N"),
            [me.dynamicsymbols("q")],
            [me.dynamicsymbols("u")],
            kd_eqs=[me.dynamicsymbols("q", 1) - me.dynamicsymbols("u")],
        )
    ),
}


@pytest.mark.parametrize("sentence", BAD)
def test_what_cannot_be_expressed_is_refused_with_a_sentence(sentence):
    with pytest.raises((TypeError, ValueError)) as raised:
        BAD[sentence]()
    assert sentence in str(raised.value)


def test_a_missing_sympy_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy.physics.mechanics", None)
    with pytest.raises(ImportError, match=r"pip install 'liouville\[sympy\]'"):
        lv.from_sympy(None)


def test_friction_by_its_sign():
    """Python's printer writes a sign as conditions, which CasADi's symbols have none of."""
    q, c = me.dynamicsymbols("q"), sympy.Symbol("c")
    frame, mass = me.ReferenceFrame("N"), me.Point("P")
    mass.set_vel(frame, q.diff(T) * frame.x)
    friction = [(mass, -c * sympy.sign(q.diff(T)) * abs(q) * frame.x)]
    method = me.LagrangesMethod(q.diff(T) ** 2 / 2, [q], forcelist=friction, frame=frame)
    method.form_lagranges_equations()
    run = {"t": (0, 1), "steps": 20, "q": [1.0], "v": [2.0], "params": {"c": 0.3}}
    system = lv.from_sympy(method, params={"c": 0.3})
    own = lv.Lagrangian(
        lambda t, q, v, p: v[0] ** 2 / 2,
        force=lambda t, q, v, p: -p.c * ca.sign(v) * ca.fabs(q),
        q=1, params={"c": 0.3},
    )  # fmt: skip
    found, wanted = (lv.integrate(x, lv.Spark(2), **run).q for x in (system, own))
    assert found == pytest.approx(wanted, abs=1e-13)


def choices():
    x = me.dynamicsymbols("x")
    k = sympy.Symbol("k")
    return {
        "Max": -100 * sympy.Max(x, 0, x**2),
        "Min": sympy.Min(x, k, -0.2),
        "Mod": sympy.Mod(x, 2),
        "Mod of a negative number": sympy.Mod(x, -k),
        "floor and ceiling": sympy.floor(3 * x) + sympy.ceiling(5 * x) ** 2,
        "Heaviside": sympy.Heaviside(x) + sympy.Heaviside(x, 2),
        "Piecewise": sympy.Piecewise((-100 * x, x > 0), (0, True)),
        "Piecewise of conditions": sympy.Piecewise(
            (-k * x, (x > 0.1) & (x <= 2)), (3, (x >= 5) | sympy.Ne(x, 0)), (sympy.Max(k, 1), True)
        ),
        "Piecewise without True": sympy.Piecewise((x, x > 0), (2 * x, x <= 0)),
    }


@pytest.mark.parametrize("case", choices())
def test_functions_that_choose_are_those_of_sympy(case):
    force, x = choices()[case], me.dynamicsymbols("x")
    frame, point = me.ReferenceFrame("N"), me.Point("P")
    point.set_vel(frame, x.diff(T) * frame.x)
    lagrangian = me.Lagrangian(frame, me.Particle("p", point, 1))
    method = me.LagrangesMethod(lagrangian, [x], forcelist=[(point, force * frame.x)], frame=frame)
    system = lv.from_sympy(method, {"k": 7.0})
    for at in (-0.31, 0.0, 0.31, 5.5):
        wanted = float(force.subs({x: at, sympy.Symbol("k"): 7.0}))
        found = lv.integrate(system, lv.HHT(), t=(0, 1e-9), steps=1, q=[at], v=[0])
        assert found.acceleration[0, 0] == pytest.approx(wanted, rel=1e-14, abs=1e-14)


def test_a_piecewise_that_leaves_a_gap_is_refused():
    x, frame, point = me.dynamicsymbols("x"), me.ReferenceFrame("N"), me.Point("P")
    point.set_vel(frame, x.diff(T) * frame.x)
    lagrangian = me.Lagrangian(frame, me.Particle("p", point, 1))
    load = (point, sympy.Piecewise((x, x > 0)) * frame.x)
    method = me.LagrangesMethod(lagrangian, [x], forcelist=[load], frame=frame)
    with pytest.raises(ValueError, match="none of its conditions holds\nhint: end it with"):
        lv.from_sympy(method)
