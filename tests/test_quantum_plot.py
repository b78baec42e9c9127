"""Panels of wave functions: what they draw is what was computed."""

from dataclasses import replace

import numpy as np
import pytest

import liouville as lv
from liouville import plot
from liouville.plot.quantum import transformed
from liouville.problems import harmonic_oscillator, tight_binding


@pytest.fixture(scope="module")
def swinging():
    times = np.linspace(0, 40, 1601)
    return lv.integrate(
        harmonic_oscillator.system, lv.SchrodingerSplitting(), t=times, **harmonic_oscillator.start
    )


def test_a_map_of_a_packet_is_brightest_where_it_is(swinging):
    axes = plot.density(swinging)
    (mesh,) = axes.collections
    shown = np.asarray(mesh.get_array())
    x = swinging.system.grid.points[:, 0]
    found = x[shown.argmax(axis=1)]
    times = swinging.t[:: -(-len(swinging.t) // 1000)]
    assert abs(found - 2 * np.cos(times)).max() < 0.75 * (x[1] - x[0])
    assert axes.get_xlabel().startswith("$x$")


def test_a_map_of_a_plane_is_of_one_time():
    solution = lv.integrate(
        tight_binding.disordered, "auto", t=(0, 1), **tight_binding.disordered_start
    )
    (mesh,) = plot.density(solution, at=0).collections
    (row, column) = np.argwhere(np.asarray(mesh.get_array()) > 0.5)[0]
    assert (row, column) == (7, 7)
    cube = lv.Schrodinger(lv.Lattice((4, 4, 4)))
    solid = replace(solution, system=cube, states={"psi": np.ones((2, 64))})
    with pytest.raises(ValueError, match="a state on 4 x 4 x 4 places has no map"):
        plot.density(solid)


def test_a_spectrum_has_peaks_at_the_energies_as_high_as_their_weights(swinging):
    axes = plot.spectrum(swinging, energies=np.arange(8) + 0.5)
    energy, values = axes.lines[0].get_data()
    for n in range(6):
        near = abs(energy - n - 0.5) < 0.4
        weight = np.exp(-2.0) * 2.0**n / np.prod(np.arange(1, n + 1.0))  # Poisson's, of mean 2
        assert abs(energy[near][values[near].argmax()] - n - 0.5) < 0.03
        assert values[near].max() == pytest.approx(weight, abs=0.005)


def test_a_spectrum_of_few_times_is_folded_and_says_so(swinging):
    few = replace(
        swinging,
        t=swinging.t[::40],
        observed={"autocorrelation": swinging.observed["autocorrelation"][::40]},
    )
    texts = [x.get_text() for x in plot.spectrum(few).get_legend().get_texts()]
    seen = few.system.bounds[0] + 2 * np.pi / few.t[1]
    assert texts == [f"spectrum, with energies above {seen:.3g} folded into it"]
    uneven = replace(few, t=few.t**2)
    with pytest.raises(ValueError, match="equally far apart\nhint: give t="):
        plot.spectrum(uneven)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_transform_finds_a_frequency_forwards_and_backwards(sign):
    t = sign * np.linspace(0, 30, 301)
    frequency, values = transformed(t, np.exp(-2.5j * t), -1.0)
    assert frequency[0] >= -1.0
    assert abs(frequency[values.argmax()] - 2.5) < 0.02
    assert values.max() == pytest.approx(1.0, abs=0.01)


def test_an_autocorrelation_has_its_modulus_and_its_parts(swinging):
    axes = plot.autocorrelation(swinging)
    overlap = swinging.observed["autocorrelation"]
    for line, values in zip(axes.lines, (abs(overlap), overlap.real, overlap.imag), strict=True):
        assert np.array_equal(line.get_ydata(), values)
    with pytest.raises(ValueError, match="no autocorrelation"):
        plot.autocorrelation(replace(swinging, observed={}))


def test_costs_are_drawn_in_order():
    axes = plot.cost({"a": ([30, 10, 20], [1e-9, 1e-3, 1e-6]), "b": ([5], [0.0])})
    assert axes.lines[0].get_xdata().tolist() == [10, 20, 30]
    assert axes.lines[1].get_ydata() == [plot.FLOOR]
