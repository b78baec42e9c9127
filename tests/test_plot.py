import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

import liouville as lv
from liouville import plot, problems
from liouville.plot import canvas, panels


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
    for suffix in plot.FIGURES:
        figure.savefig(tmp_path / f"overview{suffix}")


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
    assert len(spiked.get_xdata()) <= panels.POINTS + 2
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
    assert len(curves(figure.axes[0])) == panels.CURVES


@pytest.mark.parametrize("count", [2, 7, 8, 40])
def test_colours_differ_in_lightness_or_in_blue_so_that_all_eyes_tell_them_apart(count):
    # What a red-green blind eye keeps of a colour: about its lightness and its blue.
    seen = np.array([to_rgb(colour) for colour in canvas.colours(count)]) @ np.array(
        [[0.3, 0.0], [0.6, 0.0], [0.1, 1.0]]
    )
    apart = np.linalg.norm(seen[:, None] - seen, axis=2) + np.eye(count)
    assert apart.min() > 0.3 / count


def test_an_unknown_name_is_refused_with_those_there_are(solution):
    with pytest.raises(ValueError, match=r"no coordinate 'z'\nhint: it has x, y"):
        plot.trajectories(solution, against="z")
    with pytest.raises(ValueError, match=r"no invariant 'spin'\nhint: it has energy"):
        plot.invariants(solution, ["spin"])
    with pytest.raises(ValueError, match=r"no constraint 'rope'\nhint: it has rod"):
        plot.multipliers(solution, names=["rope"])


def test_an_animation_moves_for_as_long_as_asked(solution, tmp_path):
    outline = problems.load("pendulum").outline
    plot.animation(solution, outline, tmp_path / "swing.gif", seconds=1.0, fps=10)
    blue = np.array(to_rgb(plot.COLOURS[0])) * 255
    with Image.open(tmp_path / "swing.gif") as film:
        assert film.n_frames == 10
        rods = []
        for i in (0, 9):
            film.seek(i)
            rods.append(np.abs(np.array(film.convert("RGB")) - blue).max(axis=2) < 20)
    assert min(rod.sum() for rod in rods) > 200
    assert np.sum(rods[0] & rods[1]) < 0.2 * np.sum(rods[0])
    with pytest.raises(ValueError, match=r"hint: use a name that ends in \.gif"):
        plot.animation(solution, outline, tmp_path / "swing.mp4")


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
