"""Units of axes and tables: words that solutions carry into figures and files."""

import matplotlib as mpl
import pytest
import xarray

import liouville as lv
from liouville import plot
from liouville.problems import pendulum

mpl.use("agg")
UNITS = {"t": "s", "q": "m", "v": "m/s", "lam": "N/m", "energy": "J"}


@pytest.fixture(scope="module")
def run():
    return lv.integrate(pendulum.system, lv.HHT(), t=(0, 1), h=0.1, **pendulum.start)


def axes_of(axes):
    return axes.get_xlabel(), axes.get_ylabel()


def test_axes_have_the_units_given(run):
    first, second = run.names["coordinates"]
    assert axes_of(plot.trajectories(run)) == ("time $t$ (system's units)", "$q$ (system's units)")
    named = run.with_units(UNITS)
    assert run.units == {}
    assert axes_of(plot.trajectories(named)) == ("time $t$ (s)", "$q$ (m)")
    assert axes_of(plot.energy(named)) == ("time $t$ (s)", "energy (J)")
    assert axes_of(plot.multipliers(named)) == ("time $t$ (s)", "$\\lambda$ (N/m)")
    assert axes_of(plot.steps(named)) == ("time $t$ (s)", "$h$ (s)")
    assert axes_of(plot.residuals(named))[0] == "time $t$ (s)"
    mixed = run.with_units({"q": "m", f"q[{second}]": "mm"})
    assert axes_of(plot.trajectories(mixed))[1] == "$q$ (m, mm)"
    assert axes_of(plot.trajectories(mixed, against=first)) == (f"{first} (m)", f"{second} (mm)")


def test_tables_and_files_keep_units(run, tmp_path):
    first, _ = run.names["coordinates"]
    named = run.sel(time=slice(0, 0.5)).with_units(UNITS)
    named.save(tmp_path / "run.csv")
    head = (tmp_path / "run.csv").read_text().partition("\n")[0].split(",")
    assert {"t (s)", f"q[{first}] (m)", "energy (J)", "work"} <= set(head)
    named.save(tmp_path / "run.npz")
    assert lv.load(tmp_path / "run.npz").units == UNITS
    assert "q (m)" in named._repr_html_()
    assert named.sel(coordinate=[first]).units == UNITS


def test_bad_units_are_refused(run):
    with pytest.raises(ValueError, match="no quantity 'p1'"):
        run.with_units({"p1": "m"})
    with pytest.raises(ValueError, match=r"no quantity 'q\[w\]'"):
        run.with_units({"q[w]": "m"})
    with pytest.raises(TypeError, match="the unit of 'q' must be a word"):
        run.with_units({"q": 1})
    with pytest.raises(TypeError, match="units must be a mapping"):
        run.with_units("m")
    with pytest.raises(TypeError, match="units must be a mapping of names to units, not None"):
        run.with_units()


def test_units_by_keywords_are_refused_with_the_mapping_that_is_wanted(run):
    with pytest.raises(TypeError) as caught:
        run.with_units(t="s", q="m")
    sentence, hint = str(caught.value).splitlines()
    assert sentence == "with_units takes one mapping of names to units, not t='s', q='m'"
    assert hint == "hint: with_units({'t': 's', 'q': 'm'})"


def test_variables_of_datasets_have_their_units(run, tmp_path):
    named = run.with_units(UNITS)
    data = named.to_xarray()
    assert {name: data[name].attrs.get("units") for name in ("time", "q", "v", "lam")} == {
        "time": "s", "q": "m", "v": "m/s", "lam": "N/m",
    }  # fmt: skip
    assert "units" not in run.to_xarray().time.attrs
    mixed = run.with_units({"q": "m", f"q[{run.names['coordinates'][1]}]": "mm"}).to_xarray()
    assert "units" not in mixed.q.attrs
    named.save(tmp_path / "run.nc")
    with xarray.open_dataset(tmp_path / "run.nc", decode_times=False) as opened:
        assert opened.time.units == "s"
        assert opened.q.units == "m"
    again = lv.load(tmp_path / "run.nc")
    assert again.units == UNITS
    assert (again.q == run.q).all()
