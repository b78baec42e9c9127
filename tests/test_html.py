"""Tables of notebooks: their numbers, that they need nothing else, and the bar of a run."""

import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from rich import progress as of_rich

import liouville as lv
from liouville import problems
from liouville._basics import html, progress
from liouville.problems import euler_top, pendulum, tight_binding


class Cells(HTMLParser):
    """The text of each cell, row by row; complains of tags that are not closed."""

    def __init__(self, page):
        super().__init__()
        self.rows, self.open = [], []
        self.feed(page)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        if tag != "br":
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "td" in self.open or "th" in self.open:
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def swinging():
    return lv.integrate(pendulum.system, lv.Spark(2), t=(0, 1), h=0.1, **pendulum.start)


def test_a_solution_shows_shapes_and_ends_of_its_arrays(swinging):
    rows = {row[0]: row[1:] for row in Cells(swinging._repr_html_()).rows}
    end = ", ".join(f"{x:.4g}" for x in swinging.q[-1])
    assert rows["q"][:2] == ["(11, 2)", f"(1, 0) \u2192 ({end})"]
    assert rows["|hidden|"][1] == f"at most {np.abs(swinging.residuals['hidden']).max():.1e}"
    assert (
        rows["drift of energy, relative to the kinetic"][1]
        == f"at most {swinging.invariant_drift('energy').max():.1e}"
    )
    assert rows["params"][1] == "m = 1, l = 1, g = 9.81"


def test_an_ensemble_shows_medians_and_why_members_failed():
    start = {name: np.tile(x, (3, 1)) for name, x in pendulum.start.items()}
    options = {"t": (0, 1), "h": 0.1, "params": {"g": [1.0, 2.0, 9.0]}}
    many = lv.ensemble(pendulum.system, lv.Spark(2), **options, **start)
    q = many.q.copy()
    q[5:, 2] = np.nan
    broken = replace(many, states={"q": q}, status="partly failed", message="1 of 3 <failed>")
    rows = {row[0]: row[1:] for row in Cells(broken._repr_html_()).rows}
    end = ", ".join(f"{x:.4g}" for x in q[-1, :2].mean(axis=0))
    assert rows["q"][1] == f"median (1, 0) \u2192 ({end})"
    assert rows["message"][1] == "1 of 3 <failed>"
    assert rows["params"][1].endswith("g = (1) ... for each member")


def test_systems_and_plans_show_what_they_are_made_of():
    rows = dict(Cells(pendulum.system._repr_html_()).rows)
    assert rows["coordinates"] == "x, y"
    assert rows["parameters"] == "m = 1, l = 1, g = 9.81"
    assert dict(Cells(euler_top.system._repr_html_()).rows)["coordinates"] == "m1, m2, m3"
    size = str(tight_binding.system.size)
    assert dict(Cells(tight_binding.system._repr_html_()).rows)["components"] == size
    plan = lv.plan(euler_top.system, h=0.1, **euler_top.start)
    assert plan.reasons[0] in plan._repr_html_()


def test_names_are_escaped_and_nothing_is_fetched_or_run(swinging):
    name = "<script>alert(1)</script>"
    odd = lv.Lagrangian(lambda t, q, v, params: ca.dot(v, v) / 2, q=(name,))
    run = lv.integrate(odd, lv.Spark(1), t=(0, 1), h=0.5, q=[0.0], v=[1.0])
    named = replace(run, observed={name: run.t})
    whole = html.page(name, [html.heading(name), named._repr_html_(), odd._repr_html_(), name])
    assert "<script" not in whole
    assert not re.search(r"https?:|src=(?!.data:)|@import|url\(", whole)
    assert "currentColor" in whole


def test_a_sparkline_follows_its_values_and_leaves_gaps():
    values = np.array([0.0, 1.0, np.nan, 2.0, 1.0])
    (path,) = re.findall(r'd="([^"]*)"', html.sparkline(values))
    points = [tuple(map(float, point)) for point in re.findall(r"[ML](\S+) ([\d.]+)", path)]
    assert [point[1] for point in points] == [21.0, 11.0, 1.0, 11.0]
    assert path.count("M") == 2
    assert html.sparkline(np.full(3, np.nan)) == html.sparkline(np.empty((3, 0))) == ""


class Screen:
    """What stands for a terminal."""

    def __init__(self):
        self.text = ""

    def isatty(self):
        return True

    def write(self, text):
        self.text += text

    def flush(self):
        pass


def bar_of(monkeypatch):
    """Run with a bar on a terminal that is written down."""
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr(progress, "PAUSE", 0.0)
    start = pendulum.start
    lv.integrate(pendulum.system, lv.Spark(2), t=(0, 1), h=0.1, progress=True, **start)
    return screen.text


def test_a_bar_is_drawn_by_rich_where_it_is_installed(monkeypatch):
    seen = []
    monkeypatch.setattr(of_rich.Progress, "update", lambda self, task, **to: seen.append(to))
    monkeypatch.setattr(of_rich.Progress, "refresh", lambda self: None)
    bar_of(monkeypatch)
    assert seen[-1] == {"completed": 10, "total": 10}


def test_without_rich_the_bar_is_a_line_that_is_wiped_at_the_end(monkeypatch):
    monkeypatch.setitem(sys.modules, "rich", None)
    lines = bar_of(monkeypatch).split("\r")
    assert lines[-3].startswith("100%")
    assert not lines[-2].strip()


def test_a_notebook_without_widgets_has_the_plain_line(monkeypatch):
    shell = type("ZMQInteractiveShell", (), {})()
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    assert "100%" in bar_of(monkeypatch)


def test_where_nobody_looks_there_is_no_bar(capsys):
    vortex = problems.load("hill_vortex")
    x = [[0.1, 0.2, 0.3]]
    lv.ensemble(vortex.system, lv.VolumeSplitting(), t=(0, 1), h=0.5, x=x, progress=True)
    assert capsys.readouterr() == ("", "")


def test_points_and_sections_are_tables_in_a_notebook():
    from liouville.problems import abc_flow, pendulum

    run = lv.integrate(pendulum.system, lv.Spark(2), t=(0, 1), h=0.1, **pendulum.start)
    shown = run([0.25, 0.5])._repr_html_()
    assert "2 Points" in shown
    assert "<td" in shown
    assert "(2, 2)" in shown
    one = run(0.25)._repr_html_()
    assert "(1)" in one
    found = lv.section(
        abc_flow.system,
        lv.VolumeSplitting(),
        t=(0, 10),
        h=0.1,
        x=[[0.1, 0.2, 0.3]],
        plane="z",
        offset=0.5,
    )
    assert "of 1 trajectory" in found._repr_html_()
    assert str(found.x.shape) in found._repr_html_()
