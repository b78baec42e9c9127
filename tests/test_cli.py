"""The command line: what it runs, prints, refuses, and leaves with.

One file, since all commands are called by the same helper.
"""

import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from base64 import b64decode
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import liouville as lv
from liouville import _cli as cli
from liouville import plot, problems
from liouville._cli import doctor
from liouville._methods import METHODS

COMMAND = [sys.executable, "-W", "error", "-c", "from liouville._cli import main; main()"]
QUIET = {name: value for name, value in os.environ.items() if name not in ("FORCE_COLOR", "TERM")}

MODEL = """
import casadi as ca
import liouville as lv

def lagrangian(t, q, v, params):
    return ca.dot(v, v) / 2 - params.k * ca.dot(q, q) / 2

def force(t, q, v, params):
    return params.c * ca.sqrt(params.until - t)

oscillator = lv.Lagrangian(lagrangian, force=force, q=("x",),
                           params={"k": 1.0, "c": 0.0, "until": 1e9})
start = {"q": [1.0], "v": [0.0]}
"""


def process(words, cwd, **environment):
    """Run a command in a process of its own."""
    return subprocess.run(
        [*COMMAND, *words.split()],
        cwd=cwd,
        env={**QUIET, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_version_is_shown(liouville):
    ran = liouville("--version")
    assert (ran.returncode, ran.stdout.split()) == (0, ["liouville", lv._core.VERSION])


@pytest.mark.parametrize("options", ["--keep 1", "--keep 30", "--tol 1e-4 --keep 3 --until 5"])
def test_a_run_takes_the_products_that_its_plan_promises(liouville, options):
    planned = liouville(f"plan tight_binding {options}")
    promise = re.search(r"; ([\d.]+) products", planned.stdout)
    ran = liouville(f"run tight_binding {options}")
    assert re.search(rf"products +{re.escape(promise[1])}\s", ran.stdout), ran.stdout
    scheme = planned.stdout.splitlines()[0]
    assert scheme in ran.stdout


@pytest.fixture
def model(tmp_path):
    (tmp_path / "model.py").write_text(MODEL)
    return "model.py:oscillator"


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    top, path = problems.load("euler_top"), tmp_path_factory.mktemp("plan") / "plan.json"
    lv.plan(top.system, h=0.1, **top.start).save(path)
    return path.read_text()


QUBIT = """
import casadi as ca, liouville as lv, numpy as np
flip = [np.array([[0, 1], [1, 0]]), lambda t, w: ca.cos(w * t)]
qubit = lv.Schrodinger([np.diag([1.0, -1.0]), flip], params={"w": 1.9})
"""


def test_a_driven_wave_function_takes_what_auto_takes(liouville, tmp_path):
    """A series, with a part of the products that Magnus' steps take."""
    (tmp_path / "driven.py").write_text(QUBIT)
    call = "run driven.py:qubit --start psi=1,0 --until 5 --tol 1e-10 --keep 20"
    found, series = liouville(call).stdout, liouville(f"{call} --method chebyshev").stdout
    products = [re.search(r"products +(\d+)", text)[1] for text in (found, series)]
    assert products[0] == products[1]
    assert "asked for" not in liouville("plan driven.py:qubit --until 5").stdout


def test_a_sweep_of_a_wave_function_from_a_complex_start_keeps_it_at_given_times(
    liouville, tmp_path
):
    (tmp_path / "driven.py").write_text(QUBIT)
    call = "run driven.py:qubit --start psi=0.6,0.8j --until 5 --at 1 --at 3"
    ran = liouville(f"{call} --sweep w=1:2:3 --out many.npz")
    assert ran.returncode == 0, ran.stderr
    many = lv.load(tmp_path / "many.npz")
    assert many.t.tolist() == [0.0, 1.0, 3.0, 5.0]
    assert many.psi[0, 2].tolist() == [0.6, 0.8j]
    for member, w in enumerate((1.0, 1.5, 2.0)):
        assert liouville(f"{call} --param w={w} --out one.npz").returncode == 0
        assert np.array_equal(lv.load(tmp_path / "one.npz").psi, many.psi[:, member])


def test_a_run_prints_results_saves_and_draws(liouville, tmp_path, monkeypatch):
    monkeypatch.setattr(plot, "animation", partial(plot.animation, seconds=0.2))
    ran = liouville(
        "run pendulum --stages 2 --h 0.02 --until 1 --every 5 "
        "--out run.nc --plot run.png --animate run.gif"
    )
    assert ran.returncode == 0, ran.stderr
    assert "status" in ran.stdout
    assert ran.stderr.splitlines() == ["wrote run.nc", "wrote run.png", "wrote run.gif"]
    assert {path.name for path in tmp_path.iterdir()} == {"run.nc", "run.png", "run.gif"}
    solution = lv.load(tmp_path / "run.nc")
    assert len(solution.t) == 11
    pendulum = problems.load("pendulum")
    same = lv.integrate(
        pendulum.system, lv.Spark(stages=2), t=(0.0, 1.0), h=0.02, every=5, **pendulum.start
    )
    np.testing.assert_array_equal(solution.q, same.q)
    assert f"{same.q[-1, 0]:.15g}" in ran.stdout


def test_an_end_state_is_compared_with_the_reference_where_there_is_one(liouville):
    shown = liouville("run pendulum --stages 4").stdout
    line = next(line for line in shown.splitlines() if line.startswith("q from reference"))
    assert float(line.split()[-1]) < 1e-10
    other = liouville("run pendulum --param g=1.0").stdout
    assert "reference" not in other


def test_a_run_with_contacts_tells_how_often_they_changed(liouville):
    lines = liouville("run rocking_block --until 1").stdout.splitlines()
    told = [line.strip().split(maxsplit=2)[1:] for line in lines if line.startswith("contact ")]
    assert told == [["'left'", "1 hit, 1 stop"], ["'right'", "1 closing, 1 departure, 1 stop"]]


def test_a_model_file_runs_with_its_start_and_parameters_changed(liouville, tmp_path, model):
    words = f"run {model} --h 0.01 --until 1 --param k=4 --start q=2 --out run.nc"
    ran = liouville(words)
    assert ran.returncode == 0, ran.stderr
    solution = lv.load(tmp_path / "run.nc")
    assert solution.params["k"] == 4.0
    np.testing.assert_allclose(solution.q[-1], 2 * np.cos(2.0), rtol=1e-10)


def test_a_failed_run_is_kept_and_leaves_with_1(liouville, tmp_path, model):
    words = "--h 0.01 --until 2 --param c=1 --param until=1 --out run.nc --plot run.pdf"
    ran = liouville(f"run {model} {words}")
    assert ran.returncode == 1
    assert ran.stderr.startswith("error: ")
    assert "\nhint: " in ran.stderr
    assert "failed" in ran.stdout
    solution = lv.load(tmp_path / "run.nc")
    assert solution.status == "failed"
    assert 0.9 < solution.t[-1] <= 1.0
    assert (tmp_path / "run.pdf").exists()


def test_a_stored_run_that_was_killed_is_resumed(liouville, model, tmp_path):
    words = f"run {model} --until 300 --h 0.01 --checkpoint 1000 --store"
    path = tmp_path / "run.zarr"
    process = subprocess.Popen([*COMMAND, *words.split(), "run.zarr"], cwd=tmp_path, env=QUIET)
    while not path.exists():
        assert process.poll() is None, "the run has ended without a store"
        time.sleep(0.01)
    process.kill()
    process.communicate()
    resumed = liouville("resume run.zarr")
    assert resumed.returncode == 0
    assert "0 to 300" in resumed.stdout
    assert liouville(f"{words} whole.zarr").returncode == 0
    assert lv.load(path).q.tobytes() == lv.load(tmp_path / "whole.zarr").q.tobytes()

    again = liouville(f"{words} run.zarr")
    assert again.returncode == 2
    assert "hint: liouville.resume('run.zarr') goes on" in again.stderr
    refused = liouville(f"{words} other.zarr --out run.nc")
    assert refused.returncode == 2
    assert "it takes no --out" in refused.stderr


def test_an_interrupted_run_is_kept_and_leaves_with_130(tmp_path):
    pty = pytest.importorskip("pty")
    words = ["run", "pendulum", "--until", "1e6", "--every", "1000", "--out", "run.npz"]
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, *words], cwd=tmp_path, env={**QUIET, "TERM": "xterm"},
        stdout=subprocess.PIPE, stderr=theirs, text=True,
    )  # fmt: skip
    os.close(theirs)
    shown = ""
    while "steps/s" not in shown:  # on a terminal there is a bar, with the rate in it
        shown += os.read(ours, 1000).decode(errors="replace")
    process.send_signal(signal.SIGINT)
    try:
        while chunk := os.read(ours, 1000).decode(errors="replace"):
            shown += chunk
    except OSError:  # how Linux says that the other side is closed
        pass
    os.close(ours)
    output, _ = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "left" in shown
    assert "interrupted at t = " in shown
    assert "interrupted" in output
    solution = lv.load(tmp_path / "run.npz")
    assert solution.status == "interrupted"
    assert 0 < solution.t[-1] < 1e6


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("run pendulom", "hint: did you mean 'pendulum'?"),
        ("run pendulum --method sparc", "hint: there are auto, spark, lobatto-pair, hht"),
        ("run pendulum --method hht --stages 2", "hint: it has alpha, b, less_implicit"),
        ("run pendulum --method hht --alpha 0.1", "alpha must be from -1/3 to 0"),
        ("run pendulum --method hht --atol 1e-3", "hint: give rtol="),
        (
            "run pendulum --control forward",
            "--control must be 'adaptive' or 'reversible', not 'forward'",
        ),
        ("run pendulum --method hht --control reversible", "HHT is not symmetric"),
        ("run pendulum --at 11", "--at 11 is outside the run"),
        ("run relativistic_particle --method hht", "not linear in its velocity"),
        ("run lorenz96 --method spark", "does not step polynomial fields; methods that do: Vol"),
        ("run lorenz96 --control adaptive", "depends on the state, volume is not kept"),
        ("run lorenz96 --composition BM5", "hint: did you mean 'BM6'?"),
        ("run lorenz96 --start x=1,2", "x must have shape (36,), not (2,)"),
        ("run hill_vortex --diagonal regular", "for a diagonal part of degree 2, not 3"),
        ("run hill_vortex --plan plan.json", "for a field of 3 variables and 3 terms, not 3 and"),
        ("run pendulum --plan plan.json", "<FieldPlan of 3 pieces: VolumeSplitting("),
        ("run euler_top --plan plan.json --composition S2", "it takes no --composition\nhint: "),
        ("run euler_top --plan plan.json --method hht", "it takes no --method\nhint: "),
        ("run euler_top --plan none.json", "there is no plan file 'none.json'"),
        ("run euler_top --plan broken.py", "'broken.py' is no plan that liouville saved"),
        ("plan pendulum", "pendulum is no polynomial field"),
        ("plan euler_top --stages 2", "method volume-splitting has no option 'stages'"),
        ("plan euler_top --out nowhere/plan.json", "the folder of"),
        ("plan euler_top --trials 0", "trials must be at least 1, not 0"),
        ("order euler_top --h 0", "h must be positive and finite, not 0"),
        ("run pendulum --stages 0", "stages"),
        ("run pendulum --h -0.1", "h must be positive"),
        ("run pendulum --start q=1,1", "constraint"),
        ("run pendulum --start q", "hint: write --start name="),
        ("run pendulum --param mass=1", "mass"),
        ("run pendulum --out run.txt", "hint: use one of .nc, .zarr, .npz, .mat, "),
        ("run pendulum --out nowhere/run.nc", "the folder of"),
        ("run pendulum --plot run.doc", "hint: use a name that ends in .png"),
        ("run fekete --animate run.gif", "has no outline"),
        ("run nowhere.py:system", "there is no model file"),
        ("run model.py", "hint: name one after a colon, model.py:NAME; it has oscillator"),
        ("run model.py:oscillator --h 0.1", "hint: give --until"),
        ("run model.py:oscillator --until 1", "hint: give --h"),
        ("run broken.py", "broken.py:2: NameError"),
        ("run drawn.py:rig", "'rig' of drawn.py is an assembly\nhint: its system is rig.system()"),
        ("run pendulum --step 0.1", "hint: liouville run --help"),
        ("", "hint: liouville --help"),
    ],
)
def test_a_wrong_call_leaves_with_2_before_anything_runs(
    liouville, tmp_path, model, plan, words, complaint
):
    (tmp_path / "broken.py").write_text("import casadi\nsystem = nothing\n")
    (tmp_path / "drawn.py").write_text("import liouville as lv\nrig = lv.bodies.Assembly()\n")
    (tmp_path / "plan.json").write_text(plan)
    before = sorted(tmp_path.iterdir())
    ran = liouville(words)
    assert ran.returncode == 2
    assert ran.stdout == ""
    assert ran.stderr.startswith("error: ")
    assert complaint in ran.stderr
    assert sorted(tmp_path.iterdir()) == before


FIELD = """
import liouville as lv

terms = [("x", 1, ("y",)), ("y", -1, ("x",)), ("y", -1, ("x", "x"))]
waves = lv.PolynomialField.from_terms(("x", "y"), terms)
start = {"x": [0.1, 0.2]}
interval = (0.0, 2.0)
h = 0.1
"""


def test_a_field_runs_by_volume_splitting(liouville, tmp_path):
    words = "run lorenz96 --composition BM6 --out run.nc --plot run.png"
    ran = liouville(words)
    assert ran.returncode == 0, ran.stderr
    solution = lv.load(tmp_path / "run.nc")
    lorenz = problems.load("lorenz96")
    same = lv.integrate(
        lorenz.system, lv.VolumeSplitting(composition="BM6"), t=lorenz.interval, h=lorenz.h,
        **lorenz.start,
    )  # fmt: skip
    np.testing.assert_array_equal(solution.x, same.x)
    assert same.method in ran.stdout
    assert "energy drift" in ran.stdout
    line = next(line for line in ran.stdout.splitlines() if line.startswith("x from reference"))
    assert float(line.split()[-1]) < 1e-8
    assert (tmp_path / "run.png").exists()
    (tmp_path / "model.py").write_text(FIELD)
    ran = liouville("run model.py:waves --start x=0.2,0 --out run.nc")
    assert ran.returncode == 0, ran.stderr
    assert "VolumeSplitting" in lv.load(tmp_path / "run.nc").method


def test_a_plan_is_shown_saved_and_forced(liouville, tmp_path):
    ran = liouville("plan bajer_moffatt --composition S2 --h 0.05 --out plan.json")
    assert ran.returncode == 0, ran.stderr
    plan = lv.Plan.load(tmp_path / "plan.json")
    flow = problems.load("bajer_moffatt")
    method = lv.VolumeSplitting(composition="S2")
    assert plan == lv.plan(flow.system, method, h=0.05, **flow.start)
    assert ran.stdout == f"{plan}\n"
    assert ran.stderr == "wrote plan.json\n"
    ran = liouville("run bajer_moffatt --plan plan.json --until 1 --out run.nc")
    assert ran.returncode == 0, ran.stderr
    same = lv.integrate(flow.system, plan, t=(0.0, 1.0), h=flow.h, **flow.start)
    np.testing.assert_array_equal(lv.load(tmp_path / "run.nc").x, same.x)
    ran = liouville("order bajer_moffatt --plan plan.json --until 1")
    assert ran.returncode == 0, ran.stderr
    assert float(ran.stdout.split()[-1]) == pytest.approx(2.0, abs=0.1)


def test_a_damping_method_runs_with_steps_of_its_own(liouville, tmp_path):
    ran = liouville("run pendulum --method hht --less-implicit --until 1 --out run.nc")
    assert ran.returncode == 0, ran.stderr
    solution = lv.load(tmp_path / "run.nc")
    assert solution.method == repr(lv.HHT(less_implicit=True))
    assert solution.h == pytest.approx(0.01 / 8)
    assert "dissipated" in ran.stdout


def test_tolerances_control_the_steps(liouville, tmp_path):
    ran = liouville(
        "run spherical_pendulum --method generalized-alpha --rho 0.5 --until 1 --rtol 1e-4 "
        "--atol 1e-6 --h-min 1e-6 --out run.nc"
    )
    assert ran.returncode == 0, ran.stderr
    assert "mean h" in ran.stdout
    solution = lv.load(tmp_path / "run.nc")
    assert solution.tolerances == {"rtol": 1e-4, "atol": 1e-6}
    assert np.ptp(np.diff(solution.t)) > 0.1 * solution.h
    assert solution.stats["steps"] == len(solution.t) - 1


def test_steps_follow_the_motion_reversibly(liouville, tmp_path):
    words = "run kepler_on_sphere --stages 2 --h 0.03 --control reversible --out run.nc"
    ran = liouville(words)
    assert ran.returncode == 0, ran.stderr
    steps = np.diff(lv.load(tmp_path / "run.nc").t)
    assert steps.max() > 20 * steps.min()
    assert "mean h" in ran.stdout


def test_states_are_kept_at_the_times_asked_for(liouville, tmp_path):
    ran = liouville("run spherical_pendulum --at 1.5 --at 2.5 --out run.nc")
    assert ran.returncode == 0, ran.stderr
    np.testing.assert_array_equal(lv.load(tmp_path / "run.nc").t, [1.5, 2.5])


def test_given_times_come_in_any_order_and_the_last_one_is_named(liouville):
    ran = liouville("run pendulum --at 0.7 --at 0.5 --at 0.7")
    assert ran.returncode == 0
    assert "at t = 0.7" in ran.stdout
    assert re.search(r"^t +0.5 to 0.7", ran.stdout, re.MULTILINE)
    outside = liouville("run pendulum --at 70")
    assert outside.returncode == 2
    assert "--at 70 is outside the run, from 0 to 10" in outside.stderr


@pytest.mark.parametrize(
    ("method", "order"),
    [("spark --stages 2 --h 0.1 --h 0.05 --h 0.025 --h 0.0125", 4), ("hht --alpha -0.2", 2)],
)
def test_an_order_is_the_slope_of_the_error_against_h(liouville, method, order):
    words = f"order pendulum --method {method} --until 1"
    ran = liouville(words)
    assert ran.returncode == 0, ran.stderr
    *_, last = ran.stdout.splitlines()
    name, of_q, of_v = last.split()
    assert name == "fitted"
    assert float(of_q) == pytest.approx(order, abs=0.15)
    assert float(of_v) == pytest.approx(order, abs=0.15)


def test_the_order_of_a_field_is_that_of_its_composition(liouville):
    ran = liouville("order euler_top --composition BM6 --diagonal shears")
    assert ran.returncode == 0, ran.stderr
    assert float(ran.stdout.split()[-1]) == pytest.approx(6.0, abs=0.15)
    chosen = lv.VolumeSplitting("shears", "natural", "BM6", "split")
    assert ran.stderr == f"of {chosen!r}\n"


def test_problems_and_methods_are_listed_one_a_line(liouville):
    listed = liouville("problems").stdout.splitlines()[1:]
    assert tuple(line.split()[0] for line in listed) == problems.names()
    shown = liouville("methods").stdout
    for name, method in METHODS.items():
        assert name in shown
        for item in fields(method):
            assert f"--{item.name.replace('_', '-')}" in shown
            assert item.metadata["help"] in shown


def test_a_method_added_to_the_list_brings_its_options(monkeypatch):
    @dataclass(frozen=True, kw_only=True)
    class Damped:
        """A method of tomorrow."""

        damping: float = field(default=0.5, metadata={"help": "how much is lost"})
        rounds: int | None = field(default=None, metadata={"help": "how often"})

    seen = {}
    monkeypatch.setitem(METHODS, "damped", Damped)
    monkeypatch.setattr(cli, "app", cli.typer.Typer())
    cli.app.command()(cli.options.method_options(lambda **options: seen.update(options)))
    monkeypatch.setattr(sys, "argv", ["liouville", "--damping", "0.25"])
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert not left.value.code
    assert cli.options.method_named("damped", seen) == Damped(damping=0.25)
    with pytest.raises(ValueError, match=r"spark has no option 'damping'\nhint: it has stages"):
        cli.options.method_named("spark", seen)


def test_what_is_piped_is_plain_text(tmp_path):
    ran = process("run pendulum --until 1", tmp_path, TERM="xterm")
    assert "\x1b" not in ran.stdout + ran.stderr
    assert "steps/s" not in ran.stdout + ran.stderr


# Sweeps, reports, doctor and completion


def test_a_sweep_is_an_ensemble_whose_starts_are_on_their_constraints(liouville, tmp_path):
    ran = liouville("run pendulum --sweep l=0.5:2:4 --until 1 --stages 2 --out many.npz")
    assert ran.returncode == 0, ran.stderr
    found = lv.load(tmp_path / "many.npz")
    pendulum = problems.load("pendulum")
    lengths = np.linspace(0.5, 2, 4)
    start = pendulum.system.consistent(params={"l": lengths}, **pendulum.start)
    many = lv.ensemble(
        pendulum.system, lv.Spark(2), t=(0, 1), h=pendulum.h, params={"l": lengths}, **start
    )
    np.testing.assert_array_equal(found.q, many.q)
    assert "starts were moved onto their constraints, by 1 at most" in ran.stderr
    row = next(line for line in ran.stdout.splitlines() if line.startswith("3 "))
    assert row.split()[:3] == ["3", "2", "done"]
    assert f"{many.q[-1, 3, 0]:.8g}" in row


def test_a_sweep_of_a_field_has_one_start(liouville, tmp_path):
    ran = liouville("run abc_flow --sweep A=0:1:3 --h 0.1 --until 1 --out many.npz")
    assert ran.returncode == 0, ran.stderr
    found, flow = lv.load(tmp_path / "many.npz"), problems.load("abc_flow")
    params = {"A": [0.0, 0.5, 1.0]}
    many = lv.ensemble(
        flow.system, lv.VolumeSplitting(), t=(0, 1), h=0.1, params=params, **flow.start
    )
    np.testing.assert_array_equal(found.x, many.x)


def test_a_sweep_some_of_whose_members_fail_says_which(liouville, model):
    ran = liouville(f"run {model} --h 0.1 --until 1 --param c=1 --sweep until=0.45:1.95:4")
    assert ran.returncode == 1
    assert re.search(r"status +partly failed", ran.stdout)
    assert ran.stderr.startswith("error: 2 of 4 members failed (0 and 1); the first, member 0: ste")
    rows = [line.split()[:3] for line in ran.stdout.splitlines()[-4:]]
    assert rows[0] == ["0", "0.45", "failed"]
    assert rows[3] == ["3", "1.95", "done"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("pendulum --sweep l=1:2", "'l=1:2' has no values of a parameter"),
        ("pendulum --sweep l=1:2:0", "hint: write --sweep name=from:to:count"),
        ("pendulum --sweep l=1:2:3 --rtol 1e-3", "equal steps in memory: it takes no --rtol"),
        ("pendulum --sweep l=1:2:3 --param l=1", "'l' is given twice"),
        ("pendulum --sweep w=1:2:3", "there is no parameter 'w'"),
        ("heisenberg --sweep l=1:2:3", "there is no parameter 'l'"),
        ("heisenberg --at 70", "error: --at 70 is outside the run, from 0 to 5\nhint: "),
        ("hill_vortex --sweep l=1:2:3", "there is no parameter 'l'"),
        ("pendulum --report run.pdf", "hint: name it .html"),
        ("slider_crank --out run.xyz", "is no x, y or z of a point"),
    ],
)
def test_sweeps_and_reports_that_cannot_be_are_refused(liouville, tmp_path, options, words):
    ran = liouville(f"run {options}")
    assert ran.returncode == 2
    assert words in ran.stderr
    assert not any(tmp_path.iterdir())


def test_a_report_is_one_page_with_picture_command_and_table(liouville, tmp_path):
    ran = liouville("run pendulum --until 0.5 --stages 2 --report run.html")
    assert ran.returncode == 0, ran.stderr
    page = (tmp_path / "run.html").read_text(encoding="utf-8")
    assert "liouville run pendulum --until 0.5 --stages 2 --report run.html" in page
    (picture,) = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert b64decode(picture).startswith(b"\x89PNG")
    drift = re.search(r"energy drift, relative to the kinetic +(\S+)", ran.stdout)[1]
    assert re.search(
        rf"energy drift, relative to the kinetic</td><td[^>]*>{re.escape(drift)}<", page
    )
    assert not re.search(r"https?:|<script|<link", page)


def test_the_report_of_a_failed_run_says_why(liouville, tmp_path, model):
    words = f"run {model} --h 0.1 --until 1 --param c=1 --param until=0.45 --report run.html"
    assert liouville(words).returncode == 1
    page = (tmp_path / "run.html").read_text(encoding="utf-8")
    assert re.search(r"<p>step 4 of 10 at t = 0\.4 failed", page)


def test_the_doctor_names_what_is_missing_and_what_the_machine_gives(liouville, monkeypatch):
    found = {"numpy": "2.0", "casadi": "3.7"}
    monkeypatch.setattr(doctor, "_version", found.get)
    monkeypatch.setattr(doctor, "memory", lambda: 3 * 2.0**30)
    monkeypatch.setattr(doctor, "processors", lambda: 5)
    monkeypatch.setattr(doctor, "_features", lambda: {"AVX2", "FMA3", "AVX512F"})
    ran = liouville("doctor")
    lines = [line.split() for line in ran.stdout.splitlines()]
    rows = {line[0]: " ".join(line[1:]) for line in lines}
    assert ran.returncode == 0
    assert [line[0] for line in lines].count("scipy") == 1
    assert rows["liouville"] == lv._core.VERSION
    assert rows["casadi"] == "3.7"
    assert rows["pyarrow"] == 'missing pip install "liouville[parquet]"'
    assert rows["instructions"] == "AVX2 (x86-64-v3)"
    assert (rows["threads"], rows["memory"]) == ("5", "3.0 GiB available")


def test_the_doctor_fails_where_the_core_does_not_load(liouville, monkeypatch):
    monkeypatch.setitem(sys.modules, "liouville._core", None)
    ran = liouville("doctor")
    assert ran.returncode == 1
    assert "the core does not load: " in ran.stdout


def test_the_doctor_knows_the_extras():
    project = Path(__file__).parent.parent / "pyproject.toml"
    extras = tomllib.loads(project.read_text("utf-8"))["project"]["optional-dependencies"]
    named = {
        extra: {re.match(r"[\w-]+", package)[0] for package in extras[extra]}
        for extra in doctor.EXTRAS
    }
    assert named == {extra: set(packages) for extra, packages in doctor.EXTRAS.items()}
    public = set(re.findall(r"\w+", extras["all"][0])) - {"liouville"}
    assert set(doctor.EXTRAS) == public


@pytest.mark.parametrize(
    ("typed", "offered"),
    [("run slider", "slider_crank"), ("run pendulum --method hh", "hht"), ("doc", "doctor")],
)
def test_a_shell_completes_commands_problems_and_methods(liouville, monkeypatch, typed, offered):
    monkeypatch.setenv("_LIOUVILLE_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", f"liouville {typed}")
    monkeypatch.setenv("COMP_CWORD", str(len(typed.split())))
    assert liouville("").stdout.split() == [offered]


@pytest.mark.parametrize(
    ("call", "taken"),
    [
        ("pendulum", "Spark(stages=3)"),
        ("pendulum --rtol 1e-9", "Spark(stages=7)"),
        ("abc_flow", "BM4"),
        ("tight_binding --keep 2", "Chebyshev"),
    ],
)
def test_auto_is_a_method(liouville, call, taken):
    ran = liouville(f"run {call} --method auto")
    assert ran.returncode == 0, ran.stderr
    assert taken in ran.stdout
    refused = liouville(f"run {call} --method auto --stages 3")
    assert "method auto has no options, and --stages is one" in refused.stderr


BARE = """
import liouville as lv
p = lv.Lagrangian(lambda t, q, v, params: (v[0]**2 - params.g * q[0]**2) / 2, q=("x",),
    params={"g": 1.0})
"""


def test_a_saved_run_is_shown_drawn_converted_and_reported(liouville, tmp_path):
    assert liouville("run pendulum --until 1 --out run.npz").returncode == 0
    shown = liouville("show run.npz")
    assert shown.returncode == 0
    assert "Spark(stages=3)" in shown.stdout
    assert "energy" in shown.stdout
    for call, name in (
        ("plot run.npz a.png", "a.png"), ("plot run.npz b.svg --of energy", "b.svg"),
        ("convert run.npz c.csv", "c.csv"), ("convert run.npz d.nc", "d.nc"),
        ("report run.npz e.html", "e.html"),
    ):  # fmt: skip
        done = liouville(call)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / name).stat().st_size > 100
    assert lv.load(tmp_path / "d.nc") == lv.load(tmp_path / "run.npz")
    for call, words in (
        ("show no.npz", "there is no file"), ("plot run.npz a.png --of x", "--of must be one of"),
        ("convert run.npz a.x", "cannot tell the kind"), ("report run.npz a.png", "name it .html"),
    ):  # fmt: skip
        wrong = liouville(call)
        assert wrong.returncode == 2
        assert words in wrong.stderr


def test_all_that_is_missing_of_a_run_is_named_at_once(liouville, tmp_path):
    (tmp_path / "own.py").write_text(BARE)
    wrong = liouville("run own.py:p")
    assert wrong.returncode == 2
    assert (
        "the end time, the step size, the start 'q' and the start 'v' are missing" in wrong.stderr
    )
    hint = "give --until 10 --h 0.01 --start q=0 --start v=0"
    assert hint in " ".join(wrong.stderr.split())
    assert liouville("run own.py:p --until 10 --h 0.01 --start q=0 --start v=0").returncode == 0


def test_a_sweep_takes_values(liouville, tmp_path):
    (tmp_path / "own.py").write_text(BARE)
    call = "run own.py:p --until 1 --h 0.1 --start q=1 --start v=0 --out run.npz --sweep g=1,2,3"
    assert liouville(call).returncode == 0
    assert lv.load(tmp_path / "run.npz").params["g"] == [1.0, 2.0, 3.0]


def test_without_its_extra_the_program_says_in_a_line_what_to_install():
    code = (
        "import sys; sys.modules['typer'] = None; sys.argv = ['liouville', '--help']; "
        "from liouville.__main__ import main; main()"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ran.returncode == 1
    assert ran.stderr.count("\n") == 1
    assert 'pip install "liouville[cli]"' in ran.stderr
