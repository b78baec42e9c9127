"""What every plot function draws, of single runs and ensembles of mechanics, fields and waves.

One file, since one table has the check of each function, and a test that none is missing.
"""

import inspect
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import liouville as lv
from liouville import plot, problems
from liouville.analysis.convergence import Study
from liouville.plot import canvas, thinning

MEMBERS = 3


def _of_mechanics(many):
    problem = problems.load("double_pendulum")
    span = {"t": (0.0, 0.5), "h": 0.01}
    span["observe"] = {"height": lambda t, q, v, p: q[3], "middle": lambda t, q, v, p: q[:2] / 2}
    q = np.array([[1.0, 0.0, 2.0, 0.0], [0.0, -1.0, 0.0, -2.0], [0.6, -0.8, 0.6, -1.8]])
    v = np.array([[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 2.5, 0.0], [0.0, 0.0, 1.0, 0.0]])
    if many:
        return lv.ensemble(problem.system, lv.HHT(), q=q, v=v, **span)
    return lv.integrate(problem.system, lv.HHT(), q=q[1], v=v[1], **span)


def _of_fields(many):
    problem = problems.load("euler_top")
    x = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.1], [0.3, 0.4, 0.5]])
    run, x = (lv.ensemble, x) if many else (lv.integrate, x[0])
    return run(problem.system, lv.VolumeSplitting(), t=(0, 4), h=0.05, x=x)


def _of_waves(many):
    system = lv.Schrodinger(lv.Lattice((16,)))
    psi = np.eye(16)[[3, 8, 11]]
    t, run, psi = np.linspace(0, 4, 41), *((lv.ensemble, psi) if many else (lv.integrate, psi[0]))
    return run(system, lv.SchrodingerSplitting(), t=t, psi=psi)


OF = {"mechanics": _of_mechanics, "fields": _of_fields, "waves": _of_waves}


@pytest.fixture(scope="module")
def runs():
    return {(kind, many): OF[kind](many) for kind in OF for many in (False, True)}


def lines(axes):
    return [line for line in axes.lines if line.get_linestyle() == "-"]


def members_of(solution, values):
    """Give values of shape (k, ...) or (k, P, ...) as (P, k, ...)."""
    return values[None] if solution.members is None else np.moveaxis(values, 1, 0)


def curves_of(solution, columns):
    """Give what is to be drawn: for each member a curve for each column."""
    whole = [members_of(solution, values) for values in columns]
    return [each[member] for member in range(solution.members or 1) for each in whole]


def check_curves(axes, solution, columns):
    expected = curves_of(solution, columns)
    assert len(lines(axes)) == len(expected)
    for line, values in zip(lines(axes), expected, strict=True):
        np.testing.assert_array_equal(line.get_xdata(), solution.t[: len(values)])
        np.testing.assert_allclose(line.get_ydata(), values, rtol=0, atol=1e-15)


def check_worst(axes, solution, sizes):
    """Check dots, the largest sizes of the members after the start, and lines, their maximum."""
    expected = [members_of(solution, each).max(axis=0)[1:] for each in sizes]
    dots = [line for line in axes.lines if line.get_linestyle() != "-"]
    assert len(dots) == len(expected)
    for dot, line, size in zip(dots, lines(axes), expected, strict=True):
        floor = np.maximum(size, plot.FLOOR)
        np.testing.assert_array_equal(dot.get_ydata(), floor)
        worst = line.get_ydata()
        drawn = np.isfinite(worst)
        np.testing.assert_array_equal(worst[drawn], np.maximum.accumulate(floor)[drawn])
        assert np.all(size[~drawn] <= plot.FLOOR)


def drifts(solution):
    for name, values in solution.invariants.items():
        start = np.abs(values[0])
        if name == "energy" and "p" in solution.states:
            kinetic = np.abs(np.sum(solution.v * solution.p, axis=-1)).max(axis=0) / 2
            start = np.where(start > 1e-12 * kinetic, start, kinetic)
        yield np.abs(values - values[0]) / np.where(start > 0, start, 1.0)


def check_trajectories(solution):
    for state, values in solution.states.items():
        if state == "psi":
            with pytest.raises(ValueError, match=r"no state 'psi'.*\nhint: plot.density draws psi"):
                plot.trajectories(solution)
            continue
        check_curves(plot.trajectories(solution, state), solution, np.moveaxis(values, -1, 0))
    if "x" in solution.states:
        check_curves(plot.trajectories(solution), solution, np.moveaxis(solution.x, -1, 0))
        across = curves_of(solution, [solution.x[..., 0]])
        axes = plot.trajectories(solution, names=["m3"], against="m1")
        drawn = [line for line in lines(axes) if len(line.get_xdata()) > 1]
        for line, x, z in zip(
            drawn, across, curves_of(solution, [solution.x[..., 2]]), strict=True
        ):
            np.testing.assert_array_equal(line.get_xydata(), np.stack([x, z], axis=1))


def check_multipliers(solution):
    if not solution.names["constraints"]:
        return
    axes = plot.multipliers(solution)
    check_curves(axes, solution, np.moveaxis(solution.lam, -1, 0))
    found = [text.get_text() for text in axes.get_legend().get_texts()]
    assert found == [canvas.text(name) for name in solution.names["constraints"]]
    second = solution.names["constraints"][1]
    check_curves(plot.multipliers(solution, names=[second]), solution, [solution.lam[..., 1]])


def check_residuals(solution):
    sizes = [np.abs(values).max(axis=-1) for values in solution.residuals.values() if values.size]
    if sizes:
        check_worst(plot.residuals(solution), solution, sizes)


def check_invariants(solution):
    check_worst(plot.invariants(solution), solution, [*drifts(solution)])


def check_observed(solution):
    if "height" in solution.observed:
        check_curves(plot.observed(solution), solution, [solution.observed["height"]])
        columns = np.moveaxis(solution.observed["middle"], -1, 0)
        check_curves(plot.observed(solution, ["middle"]), solution, columns)
    if "autocorrelation" in solution.observed:
        with pytest.raises(ValueError, match="'autocorrelation' is complex"):
            plot.observed(solution, ["autocorrelation"])


def check_energy(solution):
    if not solution.balance:
        return
    columns = [solution.work - solution.dissipated]
    columns += [values for values in solution.balance.values() if values.any()]
    check_curves(plot.energy(solution), solution, columns)


def check_steps(solution):
    (line,) = lines(plot.steps(solution))
    np.testing.assert_allclose(line.get_ydata(), np.diff(solution.t))


def check_density(solution):
    if "psi" not in solution.states:
        return
    for member, psi in enumerate(members_of(solution, solution.psi)):
        axes = plot.density(solution, member=member)
        (mesh,) = axes.collections
        np.testing.assert_array_equal(np.asarray(mesh.get_array()), np.abs(psi) ** 2)
        check_title(axes, solution, member)


def check_autocorrelation(solution):
    if "psi" not in solution.states:
        return
    overlaps = members_of(solution, solution.observed["autocorrelation"])
    for member, overlap in enumerate(overlaps):
        axes = plot.autocorrelation(solution, member=member)
        for line, values in zip(
            axes.lines, (abs(overlap), overlap.real, overlap.imag), strict=True
        ):
            np.testing.assert_array_equal(line.get_ydata(), values)
        check_title(axes, solution, member)


def check_spectrum(solution):
    if "psi" not in solution.states:
        return
    drawn = []
    for member, overlap in enumerate(members_of(solution, solution.observed["autocorrelation"])):
        axes = plot.spectrum(solution, member=member)
        check_title(axes, solution, member)
        energy, values = axes.lines[0].get_data()
        window = np.cos(np.pi / 2 * np.linspace(0, 1, len(overlap))) ** 2
        window[0] /= 2
        waves = np.exp(1j * np.outer(energy, solution.t))
        expected = (waves @ (window * overlap)).real / window.sum()
        np.testing.assert_allclose(values, expected, atol=1e-12)
        drawn.append(values)
    assert solution.members is None or abs(drawn[0] - drawn[1]).max() > 0.001


def check_title(axes, solution, member):
    of = "" if solution.members is None else f", member {member} of {MEMBERS}"
    assert axes.get_title(loc="left").endswith(of or axes.get_title(loc="left"))
    assert ("member" in axes.get_title(loc="left")) == bool(of)


def check_animation(solution):
    if "q" not in solution.states:
        return
    seen = []

    def outline(q, params):
        seen.append(q.copy())
        assert params.g == solution.system.params["g"]
        return [[[0.0, 0.0], q[:2], q[2:]]]

    for member, q in enumerate(members_of(solution, solution.q)):
        seen.clear()
        film = plot.animation(solution, outline, seconds=0.2, fps=10, member=member)
        np.testing.assert_array_equal(seen, q)
        film._draw_was_started = True  # it is not shown
        body = film._func(1)[0]
        np.testing.assert_array_equal(np.transpose(body.get_data()), [[0, 0], q[-1, :2], q[-1, 2:]])


def check_overview(solution):
    figure = plot.overview(solution)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    many = "" if solution.members is None else f", {MEMBERS} members"
    most = many and f", largest of {MEMBERS} members"
    member = many and f", member 0 of {MEMBERS}"
    kept = f"drift of invariants{most}"
    expected = {
        "q": [
            f"positions{many}", f"observed{many}", kept, f"energy{many}", f"residuals{most}",
            f"multipliers{many}",
        ],
        "x": [f"states{many}", kept],
        "psi": [f"$|\\psi|^2${member}", "", f"autocorrelation{member}", kept],
    }  # fmt: skip
    assert sorted(titles) == sorted(expected[next(iter(solution.states))])


CHECKS = {
    name.removeprefix("check_"): check
    for name, check in list(globals().items())
    if inspect.isfunction(getattr(plot, name.removeprefix("check_"), None))
}


@pytest.mark.parametrize("many", [False, True], ids=["single", "ensemble"])
@pytest.mark.parametrize("kind", OF)
@pytest.mark.parametrize("panel", CHECKS)
def test_a_panel_draws_what_was_computed(runs, panel, kind, many):
    CHECKS[panel](runs[kind, many])


def test_every_panel_of_solutions_is_checked():
    functions = {name for name in plot.__all__ if inspect.isfunction(getattr(plot, name))}
    # of paths, studies, runs and sections; views of mechanisms are checked by tests of their own
    others = {"check", "convergence", "cost", "fit", "section", "view"}
    assert functions - CHECKS.keys() == others


def fans_of(solution):
    """Give each panel that draws fans, with the columns of shape (k, P) that they are of."""
    for state in ("q", "lam", "x"):
        if state in solution.states:
            columns = np.moveaxis(solution.states[state], -1, 0)
            yield partial(plot.trajectories, of=state), columns
    if "lam" in solution.states:
        yield plot.multipliers, np.moveaxis(solution.lam, -1, 0)
        sizes = [np.abs(x).max(axis=-1) for x in solution.residuals.values()]
        yield plot.residuals, [np.maximum.accumulate(x)[1:] for x in sizes]
    if solution.balance:
        yield plot.energy, [solution.work - solution.dissipated, solution.dissipated]
    if "height" in solution.observed:
        yield plot.observed, [solution.observed["height"]]
    if "autocorrelation" in solution.observed:
        yield plot.autocorrelation, [np.abs(solution.observed["autocorrelation"])]
    yield plot.invariants, [x[1:] for x in drifts(solution)]


@pytest.mark.parametrize("kind", OF)
def test_a_fan_is_the_median_and_the_bands_of_all_members(runs, kind):
    solution = runs[kind, True]
    for panel, columns in fans_of(solution):
        axes = panel(solution, fan=True)
        if axes.get_yscale() == "log":
            columns = [np.maximum(x, plot.FLOOR) for x in columns]
        middles = lines(axes)
        assert len(middles) == len(columns)
        assert len(axes.collections) == 2 * len(columns)
        for k, values in enumerate(columns):
            low, quarter, middle, three, high = np.quantile(
                values, [0.05, 0.25, 0.5, 0.75, 0.95], 1
            )
            np.testing.assert_array_equal(middles[k].get_ydata(), middle)
            for band, ends in zip(
                axes.collections[2 * k : 2 * k + 2], [(low, high), (quarter, three)], strict=True
            ):
                (path,) = band.get_paths()
                expected = np.concatenate(ends)
                np.testing.assert_array_equal(np.unique(path.vertices[:, 1]), np.unique(expected))
        assert axes.get_title(loc="left").endswith("median, 50 % and 90 % of 3 members")


def test_a_fan_is_of_the_members_that_are_left(runs):
    solution = runs["fields", True]
    x = solution.x.copy()
    x[30:, 0], x[50:] = np.nan, np.nan
    (middle,) = lines(plot.trajectories(replace(solution, states={"x": x}), names=["m2"], fan=True))
    mean = np.mean(x[30:50, 1:, 1], axis=1)  # of two
    np.testing.assert_allclose(middle.get_ydata()[30:50], mean, rtol=1e-15)
    assert np.isnan(middle.get_ydata()[50:]).all()


def test_an_overview_of_fans_has_one_in_each_panel(runs):
    for kind, count in (("mechanics", 6), ("fields", 2), ("waves", 2)):
        drawn = [
            axes.get_title(loc="left") for axes in plot.overview(runs[kind, True], fan=True).axes
        ]
        assert sum("median" in title for title in drawn) == count


def test_a_fan_of_one_run_or_against_a_coordinate_is_refused(runs):
    with pytest.raises(ValueError, match="a fan is of an ensemble, and this is a single run"):
        plot.trajectories(runs["fields", False], fan=True)
    with pytest.raises(ValueError, match="a fan is drawn against time"):
        plot.trajectories(runs["fields", True], names=["m2"], against="m1", fan=True)


def test_a_study_is_drawn_with_its_slopes():
    h = np.array([0.4, 0.2, 0.1, 0.05])
    study = Study(h, {"q": 3 * h**2, "v": np.array([np.nan, 0, 1, 2])}, {"q": 2.0, "v": np.nan})
    axes = plot.convergence(study)
    np.testing.assert_array_equal(lines(axes)[0].get_xydata(), np.stack([h, 3 * h**2], 1))
    (slope,) = [line for line in axes.lines if line.get_linestyle() == "--"]
    np.testing.assert_allclose(slope.get_ydata(), 3 * h**2)
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names == ["q, order 2.00", "v"]


def test_a_failed_member_hides_no_other(runs):
    whole = runs["mechanics", True]
    names = ("q", "v", "p", "lam", "acceleration", "a")
    states = {name: whole.states[name].copy() for name in names}
    invariants = {"energy": whole.invariants["energy"].copy()}
    for values in (*states.values(), *invariants.values()):
        values[20:, 1] = np.nan
    residuals = {name: values.copy() for name, values in whole.residuals.items()}
    for values in residuals.values():
        values[20:, 1] = np.nan
    failure = lv.Failure(20, whole.t[20], "it failed")
    broken = replace(
        whole, states=states, invariants=invariants, residuals=residuals, failures={1: failure}
    )
    others = np.abs(invariants["energy"][:, [0, 2]] - invariants["energy"][0, [0, 2]])
    start = np.abs(invariants["energy"][0, [0, 2]])
    worst = (others / np.where(start > 1e-12, start, 1.0)).max(axis=1)
    drawn = lines(plot.invariants(broken))[0].get_ydata()
    assert np.isfinite(drawn[30:]).all()
    assert drawn[-1] >= worst[-1]
    assert np.isfinite(lines(plot.residuals(broken))[0].get_ydata()[-1])
    assert "1 of 3 members failed" in plot.overview(broken).get_suptitle().replace("\n", " ")
    film = plot.animation(broken, lambda q, params: [[q[:2], q[2:]]], seconds=0.1, member=1)
    film._draw_was_started = True
    assert film._func(0)


def test_long_runs_keep_their_last_and_their_largest_values(runs):
    single = runs["fields", False]
    t = np.arange(100_001.0)
    drifting = 1 + 1e-12 * np.sin(t / 1000)
    drifting[54_321] += 1e-3
    x = np.stack([np.cos(t), np.sin(t), t], axis=1)
    long = replace(single, t=t, states={"x": x}, invariants={"energy": drifting})
    (line,) = lines(plot.invariants(long))
    assert line.get_xdata()[-1] == t[-1]
    assert line.get_xdata()[np.argmax(line.get_ydata() > 5e-4)] == 54_321

    def length(line):
        return len(line.get_xdata())

    drawn = max(lines(plot.trajectories(long, names=["m2"], against="m1")), key=length)
    np.testing.assert_array_equal(drawn.get_xydata()[-1], x[-1, :2])


def test_one_place_of_many_is_seen_in_a_map():
    psi = np.zeros((3, 5001), dtype=complex)
    psi[:, 2503] = 1.0
    system = lv.Schrodinger(lv.Lattice((16,)))
    start = np.eye(16)[0]
    short = lv.integrate(system, lv.SchrodingerSplitting(), t=[0.0, 1.0, 2.0], psi=start)
    (mesh,) = plot.density(replace(short, states={"psi": psi}, system=None)).collections
    values = np.asarray(mesh.get_array())
    assert values.shape[1] <= 1000
    assert values.max(axis=1).tolist() == [1.0, 1.0, 1.0]


def test_an_outline_has_the_parameters_of_its_member_and_no_others():
    pendulum = problems.load("pendulum")
    g = np.array([9.81, 1.62])
    both = lv.ensemble(
        pendulum.system, lv.Spark(2), t=(0, 0.1), h=0.05, params={"g": g}, **pendulum.start
    )
    seen = []

    def outline(q, params):
        seen.append(params.g)
        return [[[0.0, 0.0], q]]

    plot.animation(both, outline, seconds=0.1, member=1)._draw_was_started = True
    assert set(seen) == {1.62}
    with pytest.raises(TypeError, match=r"params\['g'\]\nhint: write params.g"):
        plot.animation(both, lambda q, params: params["g"])
    with pytest.raises(AttributeError, match=r"no parameter 'length'; .* parameters: "):
        plot.animation(both, lambda q, params: params.length)


def test_members_and_states_that_are_not_there_are_refused(runs):
    with pytest.raises(ValueError, match="no member 3 of an ensemble of 3"):
        plot.density(runs["waves", True], member=3)
    with pytest.raises(ValueError, match="no member 1 of a single run"):
        plot.autocorrelation(runs["waves", False], member=1)
    with pytest.raises(ValueError, match="no state 41: 41 are kept"):
        plot.density(runs["waves", False], at=41)
    with pytest.raises(ValueError, match="no state 't' with curves\nhint: it has q, "):
        plot.trajectories(runs["mechanics", False], "t")


@pytest.mark.parametrize("what", [plot.overview, plot.energy, plot.observed, plot.density])
def test_what_is_no_solution_is_refused(what):
    words = f"what plot.{what.__name__} draws must be a solution, not 'run.nc'\nhint: integrate"
    with pytest.raises(TypeError, match=words):
        what("run.nc")


@pytest.mark.parametrize("panel", [plot.trajectories, plot.multipliers, plot.invariants])
def test_names_as_one_string_are_refused_and_not_read_as_letters(runs, panel):
    with pytest.raises(TypeError, match=r"not 'xy'\nhint: give a list, such as names=\['"):
        panel(runs["mechanics", False], names="xy")


def test_some_members_of_very_many_are_drawn_of_every_panel(runs):
    ensemble = runs["mechanics", True]
    many = {
        group: {name: np.repeat(x, 40, axis=1) for name, x in getattr(ensemble, group).items()}
        for group in ("states", "invariants", "residuals", "balance")
    }
    crowd = replace(ensemble, members=120, **many)
    for panel in (plot.energy, plot.multipliers, plot.trajectories):
        assert len(lines(panel(crowd))) <= thinning.MOST
        assert " of 120 members" in panel(crowd).get_title(loc="left")


def test_a_semi_explicit_system_is_drawn_by_its_own_letters():
    circle = lv.SemiExplicit(
        field=lambda t, y, z, params: [-y[1] + y[0] * z[0], y[0] / 2 + y[1] * z[0]],
        constraint=lambda t, y, params: {"circle": (y[0] ** 2 + y[1] ** 2 - 1) / 2},
        y=("x", "y"),
        z=("push",),
    )
    solution = lv.integrate(circle, lv.Spark(2), t=(0, 1), h=0.1, y=[1.0, 0.0])
    axes = plot.residuals(solution)
    assert axes.get_ylabel() == "$\\max |k|$,  $\\max |k_t + k_y f|$"
    check_residuals(solution)
    check_curves(plot.trajectories(solution, "z", names=["push"]), solution, solution.z.T)
    with pytest.raises(ValueError, match=r"no unknown 'x'\nhint: it has push"):
        plot.trajectories(solution, "z", names=["x"])
    titles = {axes.get_title(loc="left") for axes in plot.overview(solution).axes}
    assert titles == {"positions", "residuals", "z"}


# Drift


def test_the_drift_is_measured_from_the_start_whatever_is_kept(tmp_path):
    pendulum = problems.load("pendulum")
    q = {"q": (0.8, 0.6), "v": (0.0, 0.0)}
    span = {"t": (0.0, 10.0), "h": 0.1}
    whole = lv.integrate(pendulum.system, lv.HHT(), **span, **q)
    expected = whole.invariant_drift("energy")[73]
    assert expected > 1e-6
    one = lv.integrate(pendulum.system, lv.HHT(), t_eval=[7.3], **span, **q)
    assert one.invariant_drift("energy") == pytest.approx([expected], rel=1e-6)
    assert one.initial == {"energy": whole.invariants["energy"][0]}
    assert f"worst drift {expected:.1e} (energy)" in repr(one)
    np.testing.assert_allclose(one.dissipated, whole.dissipated[73], rtol=1e-6)
    dots = plot.invariants(one).lines[0].get_ydata()
    assert dots == pytest.approx([expected], rel=1e-6)
    start = lv.integrate(pendulum.system, lv.HHT(), t_eval=[0.0, 7.3], **span, **q)
    assert start.initial == {} == whole.initial
    assert start.invariant_drift("energy")[1] == pytest.approx(expected, rel=1e-6)
    for suffix in (".nc", ".zarr"):
        one.save(tmp_path / f"one{suffix}")
        assert lv.load(tmp_path / f"one{suffix}").initial == one.initial
    path = tmp_path / "stored.zarr"
    lv.integrate(pendulum.system, lv.HHT(), t_eval=[7.3, 8.0], **span, **q, store=path)
    stored = lv.load(path)
    assert stored.initial == one.initial
    np.testing.assert_allclose(stored.dissipated, whole.dissipated[[73, 80]], rtol=1e-6)


def test_the_label_says_where_a_drift_is_absolute(runs):
    single = runs["fields", False]
    relative, absolute = "$|I(t) - I(0)|\\,/\\,|I(0)|$", "$|I(t) - I(0)|$ (system's units)"
    k = len(single.t)
    one, zero = np.linspace(1, 2, k), np.linspace(0, 1, k)

    def labels(invariants, of=single):
        axes = plot.invariants(replace(of, invariants=invariants))
        names = [text.get_text() for text in axes.get_legend().get_texts()]
        return axes.get_ylabel(), names

    assert labels({"a": one}) == (relative, ["a"])
    assert labels({"b": zero}) == (absolute, ["b"])
    assert "drift 1.0e+00 (b, absolute)" in repr(replace(single, invariants={"b": zero}))
    assert "(b, absolute)" not in repr(replace(single, invariants={"a": 3 * one, "b": one}))
    named = "$|I(t) - I(0)|$ over $|I(0)|$, or as named"
    assert labels({"a": one, "b": zero}) == (named, ["a", "b, absolute"])
    mixed = np.stack([one, zero, zero], axis=1)
    found = labels({"c": mixed}, runs["fields", True])
    assert found == (named, ["c, absolute of 2 members"])
    assert labels({"c": mixed[:, 1:]}, replace(runs["fields", True], members=2))[0] == absolute
