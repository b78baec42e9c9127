"""Calls: what an import loads, what runs without CasADi, and that no run knows of those before."""

import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import liouville as lv
from liouville.problems import car_axis, chain, euler_top, pendulum

#: A process in which CasADi cannot be imported runs what was pickled, and writes the bits.
WITHOUT = """
import pickle, sys
sys.modules["casadi"] = None
import liouville as lv
runs, path = pickle.load(open(sys.argv[1], "rb"))
found = []
for system, method, more in runs:
    run = lv.integrate(system, method, **more)
    found.append({name: x.tobytes() for name, x in (run.states | run.invariants).items()})
found.append(lv.resume(path).status)
try:
    lv.Lagrangian(lambda t, q, v, params: v[0], q=1)
except ImportError as error:
    found.append(str(error))
pickle.dump(found, open(sys.argv[2], "wb"))
"""


def python(code, *args):
    found = subprocess.run(
        [sys.executable, "-c", code, *map(str, args)], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr[-2000:]
    return found.stdout.split()


def bits(run):
    return {name: x.tobytes() for name, x in (run.states | run.invariants).items()}


def test_an_import_loads_little():
    listed = python("import liouville, sys; print(*sys.modules)")
    outside = {name.partition(".")[0] for name in listed}
    assert not outside & {"casadi", "scipy", "matplotlib", "xarray", "sympy", "concurrent"}
    assert not {
        "liouville.analysis",
        "liouville._methods.planner",
        "liouville._methods.splitting",
        "liouville._runs.stored",
    } & set(listed)
    assert {"numpy", "liouville._runs.choice"} <= set(listed)


def test_names_that_are_imported_later_are_listed_and_others_refused():
    for name in dir(lv):
        assert getattr(lv, name) is not None
    assert {"plan", "Store", "resume", "load", "FieldPlan"} <= set(dir(lv))
    with pytest.raises(AttributeError, match="module 'liouville' has no attribute 'stores'"):
        _ = lv.stores


ROD = lv.bodies.Assembly(gravity=(0, -9.81, 0))
ROD.bar("rod", (0, 0), (1, 0), mass=1.0)
ROD.revolute("pin", ROD.ground, "rod", at=(0, 0))


@pytest.mark.parametrize(
    ("owner", "name", "hint"),
    [
        (lambda run: lv, "Sparc", "did you mean 'Spark'"),
        (lambda run: ROD, "hinge", "did you mean 'revolute'"),
        (lambda run: ROD, "prismatik", "did you mean 'prismatic'"),
        (lambda run: run, "stat", "did you mean 'stats'"),
        (lambda run: run.joint("pin"), "torques", "did you mean 'torque'"),
        (lambda run: run.joint("pin"), "slide", "it has angle"),
        (lambda run: run.body("rod"), "speed", "it has angular_velocity, name, point"),
    ],
)
def test_an_attribute_that_is_none_is_answered_by_the_nearest(owner, name, hint):
    """Notebooks show the message alone, without what Python adds to it."""
    run = lv.integrate(ROD.system(), t=(0, 0.1), h=0.1, **ROD.start())
    found = pickle.loads(pickle.dumps(owner(run))) if owner(run) is not lv else lv
    with pytest.raises(AttributeError, match=f"has no .*{name}.*\n?hint: {hint}"):
        getattr(found, name)
    assert not hasattr(found, name)


def test_what_runs_a_system_has_a_method_by_default():
    run = {"t": (0.0, 1.0), "h": 0.1}
    field, motion = euler_top, pendulum
    x, split = field.start["x"], lv.VolumeSplitting()
    found = lv.section(field.system, **run, plane="m1", x=[x])
    assert np.array_equal(found.x, lv.section(field.system, split, **run, plane="m1", x=[x]).x)
    for call in (lv.analysis.lyapunov, lv.analysis.extrapolate):
        one, other = (call(motion.system, *m, **run, **motion.start) for m in ((), (lv.Spark(3),)))
        assert repr(one) == repr(other)
    for call in (lv.analysis.determinant, lv.analysis.lyapunov):
        one, other = (call(field.system, *m, **run, x=x) for m in ((), (split,)))
        assert repr(one) == repr(other)
    data = {
        "t": np.linspace(0, 1, 11),
        "x": lv.integrate(motion.system, **run, **motion.start)["x"],
    }
    call = {"h": 0.1, "params": {"g": 9.0}, **motion.start}
    assert repr(lv.fit(motion.system, data=data, **call)) == repr(
        lv.fit(motion.system, lv.Spark(3), data, **call)
    )
    with pytest.raises(TypeError, match="data= is missing"):
        lv.fit(motion.system, data, **call)
    solution, _ = lv.vjp(motion.system, wrt=["q"], **run, **motion.start)
    assert bits(solution) == bits(lv.integrate(motion.system, lv.Spark(3), **run, **motion.start))
    assert lv.analysis.check_gradient(motion.system, wrt=["q"], **run, **motion.start).dot < 1e-12


@pytest.mark.parametrize("room", ["analysis", "bodies", "plot", "problems"])
def test_a_room_lists_its_public_names_alone(room):
    module = getattr(lv, room)
    listed = dir(module)
    assert all(getattr(module, name) is not None for name in listed)
    assert set(listed) == set(getattr(module, "__all__", None) or listed)
    assert not {"np", "ca", "import_module", "shapes", "searches"} & set(listed)


def test_pickled_systems_and_stored_runs_need_no_casadi(tmp_path):
    semi_explicit = lv.SemiExplicit(
        field=lambda t, y, z, params: (y[1] - params.k * z[0] * y[0], -y[0] - z[0] * y[1]),
        constraint=lambda t, y, params: y[0] ** 2 + y[1] ** 2 - 1,
        y=("a", "b"), z=("u",), params={"k": 1.0},
    )  # fmt: skip
    wave, span = lv.Schrodinger(lv.Lattice(8)), {"t": (0.0, 0.3), "steps": 3}
    runs = [
        (pendulum.system, lv.Spark(3), {**span, "params": {"g": 1.5}, **pendulum.start}),
        (pendulum.system, lv.HHT(), {**span, **pendulum.start}),
        (semi_explicit, lv.Spark(2), {**span, "y": [1.0, 0.0]}),
        (euler_top.system, lv.VolumeSplitting("shears"), {**span, **euler_top.start}),
        (wave, lv.SchrodingerSplitting(), {"t": (0, 1), "psi": np.eye(8)[0]}),
    ]
    wanted = [bits(lv.integrate(system, method, **more)) for system, method, more in runs]
    store = tmp_path / "run.zarr"

    def interrupt(done, total):
        if done > 2:
            raise KeyboardInterrupt

    more = {"t": (0.0, 400.0), "steps": 40_000, "every": 10_000, **pendulum.start}
    cut = lv.integrate(pendulum.system, lv.Spark(2), store=store, progress=interrupt, **more)
    assert cut.status == "interrupted"
    (tmp_path / "in").write_bytes(pickle.dumps((runs, str(store))))
    python(WITHOUT, tmp_path / "in", tmp_path / "out")
    *found, status, refused = pickle.loads((tmp_path / "out").read_bytes())
    assert found == wanted
    assert status == "done"
    assert "casadi" in refused.lower()
    assert "hint: pip install casadi" in refused


def test_a_run_has_the_same_bits_whatever_ran_before():
    def first(system):
        return bits(lv.integrate(system, lv.Spark(3), t=(0, 0.4), h=0.05, **pendulum.start))

    system = pickle.loads(pickle.dumps(pendulum.system))
    wanted = first(system)
    for method in (lv.Spark(3), lv.Spark(3, solver="newton"), lv.HHT(), lv.LobattoPair(2)):
        more = {"params": {"g": 3.0}, **pendulum.start}
        lv.integrate(system, method, t=(0, 1), h=0.1, **more)
    with pytest.raises(lv.IntegrationError):
        lv.integrate(system, lv.Spark(3), t=(0, 1e4), steps=1, **pendulum.start)
    assert first(system) == wanted


def test_threads_integrate_one_system_at_once():
    links = 60  # enough for the plan of the sparse constraints, which the first run makes
    built, start = chain.build(links), chain.start_for(links)
    options = {"t": (0.0, 0.01), "steps": 3, **start}
    methods = [lv.Spark(stages) for stages in (1, 2, 3, 4)] * 2
    wanted = [bits(lv.integrate(built, method, **options)) for method in methods]
    fresh = pickle.loads(pickle.dumps(built))
    with ThreadPoolExecutor(len(methods)) as pool:
        found = pool.map(lambda method: lv.integrate(fresh, method, **options), methods)
        assert [bits(run) for run in found] == wanted


def test_tableaux_are_the_same_at_every_call():
    methods = [lv.Spark(2), lv.Spark(2, points="radau"), lv.LobattoPair(3), lv.LobattoPair(3, "A")]
    ends = [
        lv.integrate(car_axis.system, method, t=(0, 0.1), steps=5, **car_axis.start).q[-1].tobytes()
        for method in (*methods, *methods)
    ]
    assert ends[:4] == ends[4:]
    assert len(set(ends)) == 4
