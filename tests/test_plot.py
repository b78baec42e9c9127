import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

import liouville as lv
from liouville import plot, problems
from liouville.plot import canvas, thinning
from liouville.problems import pendulum


@pytest.fixture(scope="module")
def solution():
    pendulum = problems.load("pendulum")
    return lv.integrate(pendulum.system, lv.Spark(stages=2), t=(0.0, 1.0), h=0.02, **pendulum.start)


def unconstrained(solution):
    none = np.empty((len(solution.t), 0))
    return replace(
        solution,
        states={**solution.states, "lam": none},
        residuals={"constraint": none, "hidden": none},
        names={**solution.names, "constraints": ()},
    )


def titles(figure):
    return [axes.get_title(loc="left") for axes in figure.axes]


def legend(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def curves(axes):
    return [line for line in axes.lines if line.get_linestyle() == "-"]


def test_an_overview_shows_motion_invariants_constraints_and_multipliers(solution, tmp_path):
    figure = plot.overview(solution)
    assert titles(figure) == ["positions", "drift of invariants", "residuals", "multipliers"]
    assert legend(figure.axes[0]) == ["x", "y"]
    assert "2" in figure.get_suptitle()
    assert "h = 0.02" in figure.get_suptitle()
    figure.savefig(tmp_path / "overview.svg")
    assert figure._repr_png_().startswith(b"\x89PNG")  # for a notebook


def test_an_overview_of_a_damping_method_shows_where_the_energy_went_and_the_steps(tmp_path):
    pendulum = problems.load("pendulum")
    span = {"t": (0.0, 1.0), "rtol": 1e-3}
    solution = lv.integrate(pendulum.system, lv.HHT(), **span, **pendulum.start)
    figure = plot.overview(solution)
    assert titles(figure) == [
        "positions", "drift of invariants", "energy", "residuals", "multipliers", "step sizes",
    ]  # fmt: skip
    assert "mean h = " in figure.get_suptitle()
    energy, steps = figure.axes[2], figure.axes[5]
    assert legend(energy) == ["change", "dissipated"]  # no force does work
    change, dissipated = (line.get_ydata() for line in curves(energy))
    np.testing.assert_allclose(change, -dissipated, atol=1e-15)
    np.testing.assert_array_equal(curves(steps)[0].get_ydata(), np.diff(solution.t))
    figure.savefig(tmp_path / "overview.png")
    thin = lv.integrate(pendulum.system, lv.HHT(), every=3, **span, **pendulum.start)
    assert titles(plot.overview(thin))[-1] == "times between kept states"


def test_an_overview_leaves_out_what_there_is_nothing_to_show_of(solution):
    free = unconstrained(solution)
    assert titles(plot.overview(free)) == ["positions", "drift of invariants"]
    speed = np.linalg.norm(solution.v, axis=1)
    light = replace(free, states={}, observed={"speed": speed})
    figure = plot.overview(light)
    assert titles(figure) == ["observed", "drift of invariants"]
    assert legend(figure.axes[0]) == ["speed"]


def test_the_overview_of_a_failed_run_says_so(solution):
    assert plot.overview(replace(solution, status="failed")).get_suptitle().endswith("failed")


def test_curves_are_the_coordinates_against_time_or_each_other(solution):
    for line, values in zip(curves(plot.trajectories(solution, "v")), solution.v.T, strict=True):
        np.testing.assert_array_equal(line.get_xdata(), solution.t)
        np.testing.assert_array_equal(line.get_ydata(), values)
    axes = plot.trajectories(solution, against="x")
    (line,) = curves(axes)
    np.testing.assert_array_equal(line.get_xydata(), solution.q)
    assert axes.get_aspect() == 1.0
    assert axes.get_xlabel() == "x (system's units)"


def test_what_is_exactly_kept_lies_at_the_floor_of_the_log_axis(solution, tmp_path):
    kept = replace(solution, invariants={"kept": np.ones(51), "lost": np.linspace(1, 2, 51)})
    axes = plot.invariants(kept)
    assert axes.get_yscale() == "log"
    assert min(np.min(line.get_ydata()) for line in axes.lines) == plot.FLOOR
    flat, rising = curves(axes)
    np.testing.assert_array_equal(flat.get_ydata(), np.full(50, plot.FLOOR))
    np.testing.assert_allclose(rising.get_ydata(), np.arange(1, 51) / 50, rtol=1e-12)
    assert [text.get_text() for text in axes.texts] == ["zero or less than $10^{-17}$"]
    axes.figure.savefig(tmp_path / "kept.png")


def test_a_long_curve_is_thinned_but_keeps_its_extremes(solution):
    t = np.arange(100_001.0)
    wave = np.sin(t / 1000)
    wave[54_321] = 7.0
    long = replace(solution, t=t, states={"q": np.stack([wave, t], axis=1)})
    spiked, _ = curves(plot.trajectories(long))
    assert len(spiked.get_xdata()) <= thinning.POINTS + 2
    assert spiked.get_xdata()[np.argmax(spiked.get_ydata())] == 54_321
    assert spiked.get_xdata()[-1] == t[-1]


def test_every_name_is_legible_in_a_legend(solution, tmp_path):
    named = replace(solution, names={**solution.names, "coordinates": ("_tip$", "Theta")})
    axes = plot.trajectories(named)
    assert legend(axes) == [r"$\_$tip\$", r"$\Theta$"]
    axes.figure.savefig(tmp_path / "named.png")
    q = np.outer(np.ones(51), np.arange(40))
    names = {**solution.names, "coordinates": tuple(f"x{i}" for i in range(40))}
    axes = plot.trajectories(replace(solution, states={"q": q}, names=names))
    assert legend(axes) == ["x0", "x8", "x16", "x23", "x31", "x39"]
    axes.figure.savefig(tmp_path / "many.png")


def test_an_overview_shows_some_of_very_many_coordinates(solution):
    names = tuple(f"x{i}" for i in range(1000))
    q = np.outer(np.ones(51), np.arange(1000))
    many = replace(solution, states={"q": q, "lam": solution.lam})
    figure = plot.overview(replace(many, names={**solution.names, "coordinates": names}))
    assert len(curves(figure.axes[0])) == thinning.CURVES


@pytest.mark.parametrize("count", [2, 7, 8, 40])
def test_colours_differ_in_lightness_or_in_blue_so_that_all_eyes_tell_them_apart(count):
    # What a red-green blind eye keeps of a colour: about its lightness and its blue.
    seen = np.array([to_rgb(colour) for colour in canvas.colours(count)]) @ np.array(
        [[0.3, 0.0], [0.6, 0.0], [0.1, 1.0]]
    )
    apart = np.linalg.norm(seen[:, None] - seen, axis=2) + np.eye(count)
    assert apart.min() > 0.3 / count


@pytest.fixture(scope="module")
def ensemble():
    vortex = problems.load("hill_vortex")
    x = np.random.default_rng(1).uniform(-0.5, 0.5, (120, 3))
    observe = {"height": lambda t, x, params: x[2], "flat": lambda t, x, params: x[:2]}
    return lv.ensemble(vortex.system, lv.VolumeSplitting(), t=(0, 1), h=0.05, x=x, observe=observe)


def test_of_an_ensemble_some_members_are_drawn_mixed(ensemble, tmp_path):
    axes = plot.trajectories(ensemble)
    lines = curves(axes)
    assert len(lines) == 3 * thinning.MEMBERS
    assert legend(axes) == ["x", "y", "z"]
    shades = [line.get_color() for line in axes.get_legend().legend_handles]
    assert shades == [line.get_color() for line in lines[:3]] == list(plot.COLOURS[:3])
    assert axes.get_title(loc="left") == "states, 50 of 120 members"
    for line, values in zip(lines, ensemble.x[:, 0].T, strict=False):
        np.testing.assert_array_equal(line.get_ydata(), values)
    np.testing.assert_array_equal(lines[-1].get_ydata(), ensemble.x[:, 117, 2])
    axes = plot.trajectories(ensemble, names=["z"], against="x")
    np.testing.assert_array_equal(curves(axes)[1].get_xydata(), ensemble.x[:, 2, [0, 2]])
    axes.figure.savefig(tmp_path / "against.png")


def test_the_overview_of_an_ensemble_has_its_worst_member(ensemble, tmp_path):
    figure = plot.overview(ensemble)
    assert titles(figure) == [
        "states, 50 of 120 members", "observed, 50 of 120 members",
        "drift of invariants, largest of 120 members",
    ]  # fmt: skip
    worst = curves(figure.axes[2])[0].get_ydata()
    assert worst[-1] == ensemble.invariant_drift("stream").max()
    figure.savefig(tmp_path / "overview.png")
    light = plot.overview(replace(ensemble, states={}))
    assert titles(light)[0] == "observed, 50 of 120 members"
    assert legend(light.axes[0]) == ["height"]
    few = replace(ensemble, members=2, states={"x": ensemble.x[:, :2]}, observed={}, invariants={})
    assert titles(plot.overview(few)) == ["states, 2 members"]


def test_a_long_method_has_room_in_the_title(ensemble):
    title = plot.overview(replace(ensemble, method="a method " * 50)).get_suptitle()
    assert title.count("\n") == 2
    assert "20 steps" in title


@pytest.fixture(scope="module")
def section():
    flow = problems.load("abc_flow")
    x = np.random.default_rng(0).uniform(0, 2 * np.pi, (9, 3))
    plane = {"plane": "z", "period": 2 * np.pi, "direction": "up"}
    return lv.section(flow.system, lv.VolumeSplitting(), t=(0, 200), h=0.1, **plane, x=x)


def points(axes):
    (drawn,) = axes.collections
    return np.asarray(drawn.get_offsets()), drawn.get_facecolor()


def rows(*columns):
    return set(zip(*(np.asarray(column).tolist() for column in columns), strict=True))


def test_a_section_has_its_points_in_the_colours_of_their_trajectories(section, tmp_path):
    axes = plot.section(section)
    where, shades = points(axes)
    colours = np.array(canvas.colours(9))[section.member]
    assert rows(*where.T, *shades.T) == rows(*section.x[:, :2].T, *colours.T)
    assert axes.collections[0].get_rasterized()
    assert axes.get_aspect() == 1.0
    assert axes.get_xlabel() == "x (system's units)"
    assert axes.get_ylabel() == "y (system's units)"
    title = axes.get_title(loc="left")
    assert title == f"z = 0 mod 2π, upwards: {len(section)} crossings of 9 trajectories"
    for suffix in plot.FIGURES:
        axes.figure.savefig(tmp_path / f"section{suffix}")


def test_angles_of_a_section_are_folded(section):
    axes = plot.section(section, period=2 * np.pi)
    where, _ = points(axes)
    assert rows(*where.T) == rows(*np.mod(section.x[:, :2], 2 * np.pi).T)
    assert axes.get_xlim() == axes.get_ylim() == (0, 2 * np.pi)
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["0", "π/2", "π", "3π/2", "2π"]
    where, _ = points(plot.section(section, ("z", "x"), period={"x": 1.0}))
    assert rows(*where.T) == rows(section.x[:, 2], np.mod(section.x[:, 0], 1.0))
    assert section.x.max() > 2 * np.pi  # nothing is done to the section itself


def test_the_title_of_a_narrow_section_is_whole(section):
    axes = plot.section(replace(section, x=section.x * [1, 50, 1]))
    axes.figure.draw_without_rendering()
    title = axes._left_title.get_window_extent()
    assert 0 <= title.x0 < title.x1 <= axes.figure.bbox.width


def test_equal_steps_are_a_level_line():
    pendulum = problems.load("pendulum")
    run = lv.integrate(pendulum.system, lv.Spark(2), t=(0, 5), h=0.01, **pendulum.start)
    low, high = plot.steps(run).get_ylim()
    assert low < 0.0051 < 0.0199 < high


def test_other_planes_have_a_picture_too(section):
    normal = np.array([0.6, 0.0, 0.8])
    slanted = replace(section, plane=(normal, np.pi), period=None, direction="both")
    axes = plot.section(slanted)
    assert (axes.get_xlabel()[0], axes.get_ylabel()[0]) == ("x", "y")
    assert axes.get_title(loc="left").startswith("0.6 x + 0.8 z = π: ")
    none = replace(section, x=np.empty((0, 3)), t=np.empty(0), member=np.empty(0, dtype=int))
    axes = plot.section(replace(none, status="interrupted"))
    assert [text.get_text() for text in axes.texts] == ["no crossings"]
    assert axes.get_title(loc="left").endswith("0 crossings of 9 trajectories, interrupted")


def test_a_section_that_cannot_be_drawn_is_refused(section):
    with pytest.raises(ValueError, match=r"no coordinate 'w'\nhint: it has x, y, z"):
        plot.section(section, ("x", "w"))
    with pytest.raises(ValueError, match="names of two coordinates, not 'xy'"):
        plot.section(section, "xy")
    with pytest.raises(ValueError, match="period must be positive and finite, not 0"):
        plot.section(section, period=0.0)
    line = replace(section, x=section.x[:, :2], names=("x", "y"), plane=(np.array([0, 1.0]), 0.0))
    with pytest.raises(ValueError, match="section of 2 coordinates is no picture"):
        plot.section(line)


def test_residuals_of_a_fit_have_the_times_and_names_of_what_was_measured():
    spring = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2, q=("x",), params={"k": 4.0}
    )
    t = np.linspace(0, 2, 21)
    data = {"t": t, "x": np.cos(2 * t), "v[x]": np.where(t < 1, -2 * np.sin(2 * t), np.nan)}
    data["square"] = np.cos(2 * t) ** 2 + 0.02
    more = {"q": [1.0], "v": [0.0], "observe": {"square": lambda t, q, v, params: q[0] ** 2}}
    found = lv.fit(spring, lv.Spark(3), data, h=0.1, params=("k",), sigma=0.01, **more)
    (trial,) = found.trials
    axes = plot.fit(found)
    drawn = {line.get_color(): line.get_xydata() for line in axes.lines[:3]}
    assert [x.get_text() for x in axes.get_legend().get_texts()] == ["x", "v[x]", "square"]
    assert [len(x) for x in drawn.values()] == [21, 10, 21]
    for name, xy in zip(("x", "v[x]", "square"), drawn.values(), strict=True):
        is_own = np.array(trial.quantities) == name
        assert np.array_equal(xy, np.stack([trial.t, trial.residuals], axis=1)[is_own])
    np.testing.assert_allclose([*drawn.values()][2][:, 1].mean(), 2.0, atol=0.2)
    with pytest.raises(TypeError, match=r"what plot\.fit draws must be a fit, not <Solution"):
        plot.fit(found.solution)


def test_an_unknown_name_is_refused_with_those_there_are(solution):
    with pytest.raises(ValueError, match=r"no coordinate 'z'\nhint: it has x, y"):
        plot.trajectories(solution, against="z")
    with pytest.raises(ValueError, match=r"no invariant 'spin'\nhint: it has energy"):
        plot.invariants(solution, ["spin"])
    with pytest.raises(ValueError, match=r"no constraint 'rope'\nhint: it has rod"):
        plot.multipliers(solution, names=["rope"])


def test_an_animation_moves_for_as_long_as_asked(solution, tmp_path):
    outline = problems.load("pendulum").outline
    blue = np.array(to_rgb(plot.COLOURS[0])) * 255

    def rods_of(outline):
        plot.animation(solution, outline, tmp_path / "swing.gif", seconds=1.0, fps=10)
        with Image.open(tmp_path / "swing.gif") as film:
            assert film.n_frames == 10
            for i in (0, 9):
                film.seek(i)
                yield np.abs(np.array(film.convert("RGB")) - blue).max(axis=2) < 20

    rods = list(rods_of(outline))
    assert min(rod.sum() for rod in rods) > 200
    assert np.sum(rods[0] & rods[1]) < 0.2 * np.sum(rods[0])
    assert np.array_equal(*rods_of(lambda q, params: [[[0.0, 0.0], [1.0, 1.0]]]))  # one layout
    with pytest.raises(ValueError, match=r"hint: use a name that ends in \.gif or \.html or \.mp4"):
        plot.animation(solution, outline, tmp_path / "swing.avi")
    plot.animation(solution, outline, tmp_path / "swing.html", seconds=1.0)
    assert "<canvas" in (tmp_path / "swing.html").read_text(encoding="utf-8")


def test_a_notebook_shows_panels(solution):
    assert plot.trajectories(solution)._repr_png_().startswith(b"\x89PNG")


def test_plotting_needs_no_screen_and_no_global_state():
    code = (
        "import sys, liouville as lv; from liouville import plot, problems; "
        "assert 'matplotlib' not in sys.modules; p = problems.load('pendulum'); "
        "plot.overview(lv.integrate(p.system, lv.Spark(), t=(0, 1), h=0.1, **p.start)); "
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, env={})


def test_without_matplotlib_the_extra_to_install_is_named(solution, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r'hint: pip install "liouville\[plot\]"'):
        plot.overview(solution)


def test_figures_are_those_of_pyplot_where_it_has_windows(monkeypatch):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    run = lv.integrate(pendulum.system, lv.Spark(2), t=(0, 1), h=0.1, **pendulum.start)
    for backend, is_known in (
        ("QtAgg", True), ("module://backend_interagg", True), ("agg", False), ("svg", False),
        ("module://matplotlib_inline.backend_inline", False),
        ("module://ipympl.backend_nbagg", False),
    ):  # fmt: skip
        pyplot.close("all")
        monkeypatch.setattr("matplotlib.get_backend", lambda name=backend: name)
        axes = plot.trajectories(run)
        assert bool(pyplot.get_fignums()) == is_known, backend
        assert not is_known or pyplot.gcf() is axes.figure
    pyplot.close("all")


def test_the_energy_of_any_method_is_drawn(solution):
    axes = plot.energy(solution)
    energy = solution.invariants["energy"]
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), energy - energy[0])
    assert axes.get_title(loc="left") == "change of the energy"
    assert axes.get_ylabel().startswith("energy")
    with pytest.raises(AttributeError, match=r"no energy\nhint: plot\.invariants draws what"):
        plot.energy(replace(solution, invariants={}))


def test_members_have_the_colours_of_the_parameter_they_differ_in():
    spring = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2, q=("x",), params={"k": 1.0}
    )
    stiff = [4.0, 1.0, 2.0]
    many = lv.ensemble(spring, lv.Spark(2), t=(0, 1), h=0.1, q=1.0, v=[0.0], params={"k": stiff})
    axes = plot.trajectories(many)
    bar = axes.figure.axes[1]
    assert bar.get_ylabel() == "k"
    assert bar.get_ylim() == (1.0, 4.0)
    shades = [to_rgb(line.get_color()) for line in axes.lines]
    assert len({*shades}) == 3
    dark = [sum(x) for x in shades]  # viridis grows lighter
    assert np.array_equal(np.argsort(dark), np.argsort(stiff))


def test_what_a_legend_leaves_out_is_counted():
    chain = problems.load("chain")
    run = lv.integrate(chain.system, lv.Spark(2), t=(0, 0.1), h=0.05, **chain.start)
    axes = plot.trajectories(run)
    assert axes.get_title(loc="left") == f"positions; 6 of {run.q.shape[1]} are named"


def test_the_label_of_a_drift_says_what_it_is_over():
    swing = lv.integrate(pendulum.system, lv.Spark(2), t=(0, 1), h=0.1, **pendulum.start)
    label = plot.invariants(swing).get_ylabel()
    assert label == "$|I(t) - I(0)|$ over the kinetic energy"  # which is zero at the start


def test_places_of_a_lattice_are_squares():
    psi = np.eye(6)[0]
    wave = lv.integrate(lv.Schrodinger(lv.Lattice((2, 3))), t=(0, 1), psi=psi)
    axes = plot.density(wave)
    assert axes.get_aspect() == 1
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("first place", "second place")


def test_methods_are_written_without_their_defaults():
    for method, words in (
        (lv.Spark(), "Spark(stages=3)"),
        (lv.Spark(2, points="radau"), "Spark(stages=2, points='radau')"),
        (lv.Spark(3, newton_tol=1e-8), "Spark(stages=3, newton_tol=1e-08)"),
        (lv.HHT(), "HHT(alpha=-0.1)"),
        (lv.VolumeSplitting(), "VolumeSplitting()"),
        (lv.VolumeSplitting(composition="Y4"), "VolumeSplitting(composition='Y4')"),
        (lv.Composition(lv.Spark(2)), "Composition(base=Spark(stages=2))"),
        (lv.Magnus(order=2), "Magnus(order=2)"),
    ):
        assert repr(method) == words
        assert eval(f"lv.{words}".replace("=Spark", "=lv.Spark"), {"lv": lv}) == method
