"""Mechanisms of any size, in one unit of length: what is found of them is the same but for it."""

import numpy as np
import pytest

import liouville as lv

ANGLE = 0.6
SIZES = [(1e-9, 1e-20), (1e-6, 1e-12), (1e-3, 1e-3), (1e5, 1e12)]


def slider_crank(length, mass, *, is_spatial):
    r, rod = 0.2 * length, 0.6 * length
    m = lv.bodies.Assembly(gravity=(0, -9.81 * length, 0))
    tilt = -np.arcsin(r * np.sin(ANGLE) / rod)
    pin = np.array([r * np.cos(ANGLE), r * np.sin(ANGLE)])
    end = pin[0] + rod * np.cos(tilt)
    masses = {"crank": mass, "rod": 1.5 * mass, "slider": 0.8 * mass}
    lengths = {"crank": r, "rod": rod, "slider": r}
    places = {"crank": (*pin / 2, 0), "rod": ((pin[0] + end) / 2, pin[1] / 2, 0)}
    places["slider"] = (end, 0, 0)
    for name, angle in (("crank", ANGLE), ("rod", tilt), ("slider", 0.0)):
        moment = masses[name] * lengths[name] ** 2 / 12
        if is_spatial:
            turned = (np.cos(angle / 2), 0, 0, np.sin(angle / 2))
            inertia = (moment / 50, moment, moment)
            m.body(name, mass=masses[name], inertia=inertia, at=places[name], rotation=turned)
        else:
            m.planar_body(name, mass=masses[name], inertia=moment, at=places[name], angle=angle)
    z = (0, 0, 1)
    m.revolute("A", m.ground, "crank", at=(0, 0, 0), axis=z)
    m.revolute("B", "crank", "rod", at=(*pin, 0), axis=z)
    m.revolute("C", "rod", "slider", at=(end, 0, 0), axis=z)
    m.prismatic("D", m.ground, "slider", axis=(1, 0, 0), spring=200.0 * mass)
    return m


def found(length, mass, *, is_spatial):
    """Return a start, a state of rest and its frequency, lengths over that of the mechanism."""
    m = slider_crank(length, mass, is_spatial=is_spatial)
    system = m.system()
    start = m.start(values={"A": 0.3}, rates={"A": 4.0})
    rest = lv.analysis.equilibrium(system, **m.start())
    names = system.coordinates
    units = np.array([length if name[-2:] in (".x", ".y", ".z") else 1.0 for name in names])
    slid = m.start(values={"D": -0.05 * length})
    places = [x / units for x in (start["q"], start["v"], rest.start["q"], slid["q"])]
    return places, rest, lv.analysis.modes(system, **rest.start).hertz


@pytest.mark.parametrize("is_spatial", [False, True], ids=["planar", "spatial"])
def test_starts_rest_and_modes_do_not_depend_on_the_unit_of_length(is_spatial):
    places, rest, hertz = found(1.0, 1.0, is_spatial=is_spatial)
    assert hertz == pytest.approx([1.641371523])
    for length, mass in SIZES:
        own, at_rest, modes = found(length, mass, is_spatial=is_spatial)
        for x, expected in zip(own, places, strict=True):
            np.testing.assert_allclose(x, expected, rtol=0, atol=1e-11)
        assert at_rest.is_stable
        assert at_rest.iterations <= rest.iterations + 1
        np.testing.assert_allclose(modes, hertz, rtol=1e-9)


def test_a_loop_too_short_is_refused_in_any_unit_with_what_it_misses():
    z = {"axis": (0, 0, 1)}
    for length in (1e-9, 1.0, 1e5):
        m = lv.bodies.Assembly()
        bars = [
            m.planar_body(f"bar{k}", mass=1.0, inertia=length**2, at=(k * length, 0))
            for k in range(2)
        ]
        m.revolute("A", m.ground, bars[0], at=(0, 0, 0), **z)
        m.revolute("B", *bars, at=(length, 0, 0), **z)
        m.revolute("C", bars[1], m.ground, at=((2 * length, 0, 0), (3 * length, 0, 0)), **z)
        m.system()
        with pytest.raises(ValueError, match=r"cannot be closed: joint '\w' misses by (\S+)") as no:
            m.start()
        missed = float(str(no.value).split("misses by ")[1].split()[0])
        assert missed == pytest.approx(length, rel=0.1)
