"""Views and films of mechanisms: what they show is where the solution has the bodies."""

import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest
from py_mini_racer import MiniRacer

import liouville as lv
from liouville import plot, problems
from liouville.bodies import rotations as rot

CODE = Path(plot.__file__).parent / "viewer" / "motion.js"


@pytest.fixture(scope="module")
def solution():
    """Return a run of a rod on a ball joint, a slider on a spring and a ball that rolls."""
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    rod = m.body("rod", mass=1.0, inertia=(0.1, 0.1, 0.01), at=(0.5, 0, 0))
    slider = m.body("slider", mass=2.0, inertia=(0.1, 0.2, 0.15), at=(0, 1, 1))
    ball = m.body("ball", mass=1.0, inertia=(0.1, 0.1, 0.1), at=(2, 0.5, 0))
    m.spherical("A", m.ground, rod, at=(0, 0, 0))
    m.prismatic("B", m.ground, slider, axis=(1, 0, 0))
    m.spring("S", slider, rod, at=((0, 1, 1), (1, 0, 0)), stiffness=9.0)
    m.rolling("R", m.ground, ball, radius=0.5, normal=(0, 1, 0))
    start = m.start(rates={"A": (1.0, 2.0, 3.0), "B": 0.5, "R": (0.0, 0.0, 2.0)})
    return lv.integrate(m.system(), lv.Spark(2), t=(0, 1), h=0.01, **start)


def motion_of(view):
    """Return what the page knows, arrays decoded."""
    (text,) = re.findall(r'<script type="application/json" id="motion">(.*?)</script>', view.page)
    found = json.loads(text)
    for name, kind in (("t", "<f8"), ("poses", "<f4"), ("points", "<f4")):
        found[name] = np.frombuffer(base64.b64decode(found[name]), kind)
    return found


def test_a_page_has_the_motion_of_all_bodies_and_needs_nothing_else(solution, tmp_path):
    view = plot.view(solution, path=tmp_path / "motion.html")
    assert (tmp_path / "motion.html").read_text(encoding="utf-8") == view.page
    assert not re.search(r"https?:|src=|href=|@import|url\(|import\(|fetch\(", view.page)
    motion = motion_of(view)
    np.testing.assert_array_equal(motion["t"], solution.t)
    poses = motion["poses"].reshape(len(solution.t), 3, 7)
    for k, name in enumerate(("rod", "slider", "ball")):
        body = solution.body(name)
        np.testing.assert_allclose(poses[:, k, :3], body.position, atol=1e-6)
        np.testing.assert_allclose(poses[:, k, 3:], body.rotation, atol=1e-6)
    assert motion["up"] == [0.0, 1.0, 0.0]
    assert motion["floor"] == pytest.approx(
        min(0.0, solution.body("rod").point((0.5, 0, 0))[:, 1].min()), abs=0.2
    )


def test_lines_of_a_body_that_travels_far_stay_visible():
    """The picture shows the whole way, on which a line as thick as the body asks for vanishes."""
    widths = []
    for speed in (0.0, 5.0):
        m = lv.bodies.Assembly()
        rod = m.bar("rod", (0, 0), (1, 0), mass=1.0)
        tail = m.bar("tail", (1, 0), (2, 0), mass=1.0)
        m.free("flight", rod)
        m.revolute("pin", rod, tail, at=(1, 0))
        start = m.start(rates={"flight": (speed, 0, None, None, None, 0)})
        run = lv.integrate(m.system(), lv.Spark(2), t=(0, 1), h=0.1, **start)
        parts = motion_of(plot.view(run))["parts"]
        widths.append(max(part["size"][0] for part in parts if part["role"] == "line"))
    assert widths[1] > 1.5 * widths[0]


def test_the_code_of_the_page_puts_shapes_where_the_bodies_are(solution):
    motion = motion_of(plot.view(solution, trace={"rod": (0.5, 0, 0)}))
    page = MiniRacer()
    page.eval(CODE.read_text(encoding="utf-8"))
    arrays = {name: motion.pop(name).tolist() for name in ("t", "poses", "points")}
    page.eval(f"const data = {json.dumps({**motion, **arrays})}")
    page.eval("for (const x of ['poses', 'points']) data[x] = new Float32Array(data[x]);")
    time = 0.4325
    (between,) = [k for k in range(len(solution.t) - 1) if solution.t[k] < time < solution.t[k + 1]]
    shapes = json.loads(page.eval(f"JSON.stringify(shapesAt(data, {time}, true))"))
    part = (time - solution.t[between]) / 0.01
    bars = [shape for shape in shapes if shape[0] == "bar" and shape[1] == 0]
    rod = solution.body("rod")
    (bar,) = bars
    middle, turn, size = bar[3:]
    ends = [
        np.array(middle) + sign * size[2] / 2 * np.array(rot.rotate(turn, (0, 0, 1)))
        for sign in (-1, 1)
    ]
    wanted = [rod.point((x, 0, 0))[between : between + 2] for x in (-0.5, 0.5)]
    wanted = [(1 - part) * pair[0] + part * pair[1] for pair in wanted]
    # a turn is interpolated along the way, and not its points
    np.testing.assert_allclose(
        sorted(np.array(ends).tolist()), sorted(np.array(wanted).tolist()), atol=2e-4
    )
    spring = shapes[-1]
    assert spring[5][2] == pytest.approx(
        np.linalg.norm(solution.body("slider").position[between] - wanted[1]), rel=0.05
    )
    boxes = {shape[1]: shape[5] for shape in shapes if shape[2]}
    # of mass 2: a^2 = 6 (0.2 + 0.15 - 0.1) / 2
    np.testing.assert_allclose(sorted(boxes[1]), np.sqrt([0.15, 0.45, 0.75]), rtol=1e-6)
    hidden = json.loads(page.eval(f"JSON.stringify(shapesAt(data, {time}, false))"))
    assert not any(shape[2] for shape in hidden)
    assert page.eval("JSON.stringify(frameAt([3, 2, 1], 1.25))") == "[1,0.75]"


def test_a_page_has_the_polylines_of_an_outline(tmp_path):
    loop = problems.load("bricard")
    run = lv.integrate(loop.system, lv.Spark(2), t=(0, 0.1), h=0.01, **loop.start)
    motion = motion_of(plot.view(run, loop.outline, up="y"))
    points = motion["points"].reshape(len(run.t), 12, 3)
    assert motion["lines"] == [[2 * k, 2] for k in range(6)]
    x, a = run.q[:, 24:27], run.q[:, 27:30]  # of the third bar
    np.testing.assert_allclose(points[:, 5], x + a / 2, atol=1e-6)


def test_long_motions_are_thinned_and_keep_their_ends(solution, monkeypatch):
    monkeypatch.setattr("liouville.plot.page.NUMBERS", 21 * 30)
    motion = motion_of(plot.view(solution))
    assert len(motion["t"]) == 30
    assert motion["t"][[0, -1]].tolist() == [0.0, 1.0]


def test_a_notebook_shows_the_page_in_a_frame(solution):
    shown = plot.view(solution)._repr_html_()
    assert shown.startswith("<iframe srcdoc=")
    assert "<script" not in shown


def test_a_film_in_space_shows_the_bodies_from_where_it_is_seen(solution):
    film = plot.animation(solution, seconds=0.4, fps=10, view=(-90.0, 0.0), trace="rod")
    film._draw_was_started = True  # it is not shown
    drawn = film._func(3)
    assert drawn[-1].get_text() == "t = 1.00"
    lines = [np.transpose(line.get_data()) for line in drawn[:-1]]
    # x goes to the right where y is up, seen from z; the rod is drawn from its joint to its centre
    centre = solution.body("rod").position[-1]
    np.testing.assert_allclose(2 * centre, solution.body("rod").point((0.5, 0, 0))[-1], atol=1e-9)
    assert any(np.allclose(x[-1], centre[:2]) or np.allclose(x[0], centre[:2]) for x in lines)


def test_a_film_goes_to_ffmpeg_where_it_is(solution, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(
        ImportError, match=r"ffmpeg, .* not on the path\nhint: install it, or write"
    ):
        plot.animation(solution, path=tmp_path / "run.mp4")
    tool = tmp_path / "ffmpeg"
    tool.write_text(
        '#!/bin/sh\nfor last; do :; done\n/bin/cat > "$last"\necho "$@" >> "$last.log"\n'
    )
    tool.chmod(0o755)
    plot.animation(solution, path=tmp_path / "run.mp4", seconds=0.4, fps=10)
    size = re.search(r"-s (\d+)x(\d+)", (tmp_path / "run.mp4.log").read_text())
    width, height = map(int, size.groups())
    assert (tmp_path / "run.mp4").stat().st_size == 4 * width * height * 4
    tool.write_text("#!/bin/sh\necho codec missing >&2\nexit 3\n")
    with pytest.raises(
        RuntimeError, match=r"could not write .*: codec missing\nhint: write a \.gif"
    ):
        plot.animation(solution, path=tmp_path / "run.mp4", seconds=0.4, fps=10)


def test_what_cannot_be_shown_is_refused_with_a_sentence(solution, tmp_path):
    pendulum = problems.load("pendulum")
    swing = lv.integrate(pendulum.system, lv.Spark(2), t=(0, 0.1), h=0.05, **pendulum.start)
    with pytest.raises(TypeError, match=r"bodies are not known.*\nhint: give outline\(q, params\)"):
        plot.view(swing)
    with pytest.raises(TypeError, match="a motion must be a solution, not Mechanism"):
        plot.view(solution.system)
    with pytest.raises(ValueError, match="there is no body 'bob'\nhint: bodies are rod, slider"):
        plot.view(solution, trace="bob")
    with pytest.raises(ValueError, match="trace of body 'rod' must be 3 finite numbers"):
        plot.view(solution, trace={"rod": (1, 2)})
    with pytest.raises(ValueError, match="up must be 'x', 'y' or 'z', not 'w'"):
        plot.view(solution, up="w")
    with pytest.raises(ValueError, match=r"polylines of shape \(k, 2\) or \(k, 3\)"):
        plot.view(swing, lambda q, params: [q])
    with pytest.raises(ValueError, match=r"hint: end its name in \.html"):
        plot.view(solution, path=tmp_path / "motion.htm")


@pytest.fixture(scope="module")
def touching():
    """Return runs of a disc and a brick on a line, and of a box and a capsule on a tilted plane."""
    flat = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    disc = flat.planar_body("disc", mass=1.0, inertia=0.02, at=(0, 1))
    brick = flat.planar_body("brick", mass=1.0, inertia=0.1, at=(2, 0.5))
    corners = np.array([(1.8, 0.4), (2.2, 0.4), (2.2, 0.6), (1.8, 0.6)])
    line = lv.bodies.Plane("ground", normal=(0, 1, 0))
    for body, shape in (
        (disc, lv.bodies.Sphere(disc, lambda params: params.r)),
        (brick, lv.bodies.Polygon(brick, corners)),
    ):
        flat.free(f"flight {body.name}", body)
        flat.contact(f"floor {body.name}", shape, line)
    flat.rope("rope", disc, "ground", at=[(0, 1, 0), (0, 3, 0)], length=3.0)
    deep = lv.bodies.Assembly(gravity=(0, 0, -9.81))
    box = deep.body("box", mass=1.0, inertia=(0.1, 0.1, 0.1), at=(0, 0, 2))
    rod = deep.body("rod", mass=1.0, inertia=(0.1, 0.1, 0.1), at=(2, 0, 2))
    plane = lv.bodies.Plane("ground", at=(0, 0, -1), normal=(0.6, 0, 0.8))
    for body, shape in (
        (box, lv.bodies.Box(box, (0.6, 0.4, 0.2))),
        (rod, lv.bodies.Capsule(rod, [(1.8, 0, 2), (2.2, 0, 2)], 0.1)),
    ):
        deep.free(f"flight {body.name}", body)
        deep.contact(f"floor {body.name}", shape, plane)
    call = {"t": (0, 0.4), "h": 0.05}
    own = flat.system(params={"r": 0.2})
    return [
        lv.integrate(own, lv.Spark(2), **call, **flat.start(params={"r": 0.2})),
        lv.integrate(deep.system(), lv.Spark(2), **call, **deep.start()),
    ]


def test_pages_show_the_shapes_that_touch(touching):
    flat, deep = (motion_of(plot.view(run)) for run in touching)
    (disc,) = [x for x in flat["parts"] if x["role"] == "wheel"]
    assert (disc["mesh"], disc["body"], disc["size"][:2]) == ("bar", 0, [0.2, 0.2])
    edges = [x for x in flat["parts"] if x["role"] == "line" and x["body"] == 1]
    assert sorted(x["size"][2] for x in edges) == pytest.approx([0.2, 0.2, 0.4, 0.4])
    assert sorted(x["at"][1] for x in edges) == pytest.approx([-0.1, 0, 0, 0.1])
    (ground,) = [x for x in flat["parts"] if x["body"] == 2]
    assert ground["at"][1] == pytest.approx(0)
    assert rot.rotate(ground["turn"], (0, 0, 1))[1] == pytest.approx(0)
    assert flat["springs"] == [[0, [0, 0, 0], 2, [0, 3, 0]]]
    (box,) = [x for x in deep["parts"] if x["role"] == "shape"]
    assert (box["mesh"], box["size"]) == ("box", [0.6, 0.4, 0.2])
    round_ones = [x for x in deep["parts"] if x["role"] == "wheel"]
    assert sorted(x["mesh"] for x in round_ones) == ["ball", "ball", "bar"]
    assert sorted(x["at"][0] for x in round_ones) == pytest.approx([-0.2, 0, 0.2])
    (plane,) = [x for x in deep["parts"] if x["role"] == "plane"]
    normal = np.array([0.6, 0, 0.8])
    np.testing.assert_allclose(rot.rotate(plane["turn"], (0, 0, 1)), normal, atol=1e-6)
    assert normal @ (np.array(plane["at"]) - [0, 0, -1]) == pytest.approx(0, abs=1e-2)


def test_films_draw_the_shapes_that_touch(touching):
    for run, count in zip(touching, (4, 5), strict=True):
        film = plot.animation(run, seconds=0.2)
        film._draw_was_started = True
        assert len(film._fig.axes[0].lines) == count
