"""What pages of the gallery say of contacts holds, by closed forms and by others' numbers."""

from pathlib import Path

import numpy as np
import pytest

import liouville as lv

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


@pytest.fixture
def page(monkeypatch):
    """Return what runs a page of the gallery, for all that it has defined at its end."""
    plt = pytest.importorskip("matplotlib.pyplot")
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))

    def run(name):
        path, scope = EXAMPLES / f"{name}.py", {}
        with plt.rc_context():
            exec(compile(path.read_text(encoding="utf-8"), path, "exec"), scope)
        return scope

    return run


def test_a_walker_has_the_published_cycle_and_law_of_small_slopes(page):
    """Bhounsule's program passivewalker; table 1 of Garcia, Chatterjee, Ruina, Coleman (1998)."""
    found = page("walker")
    off = np.abs(found["angles"] - 0.200161072169750)
    assert off[-1] < 1e-8
    assert (off[-5:].max() / off[:5].max()) ** (1 / (len(off) - 5)) == pytest.approx(0.59, abs=0.03)
    root = 0.1
    angle, v = 0.970956 * root, -1.045203 * 0.970956 * root
    run = lv.integrate(
        found["system"],
        lv.Spark(4),
        t=(0, 120),
        h=0.02,
        q=[-np.sin(angle), np.cos(angle), angle, -angle],
        v=[-np.cos(angle) * v, -np.sin(angle) * v, v, np.cos(2 * angle) * v],
        params={"slope": root**3, "step": 2 * np.sin(angle), "m": 1e-6},
    )
    lands = [x.t for x in run.contacts["left"].changes if x.kind == "hit"]
    assert run(lands[-1]).q[2] / root == pytest.approx(0.970956, abs=0.2 * root**2)
    period = 3.812092 + 1.579129 * root**2
    assert np.diff(lands)[-1] / 2 == pytest.approx(period, abs=2 * root**4)


def test_blocks_hit_as_often_as_pi_says_and_discs_share_their_energy(page, capsys):
    """Galperin (2003); the mean of x^2 with a probability (1 - x)^9 above x is 2/110."""
    found = page("billiards")
    said = capsys.readouterr().out.splitlines()
    assert said == ["1 to 1: 3 hits", "1 to 100: 31 hits", "1 to 10000: 314 hits"]
    for run in (*found["runs"].values(), found["run"]):
        assert np.max(run.invariant_drift("energy")) < 1e-12
    assert np.mean(found["share"] ** 2) == pytest.approx(2 / 110, rel=0.1)


def test_thrown_balls_roll_when_and_where_closed_forms_say(page, capsys):
    page("bowling")
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 3
    for line in said:
        when, speed = line.split("off by ")[1].split(" s, ")
        assert float(when) < 2e-9
        assert float(speed.removesuffix(" m/s")) < 2e-9
