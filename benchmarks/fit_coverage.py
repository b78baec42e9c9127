"""How often intervals of 95 % of a fit hold the truth: 200 data sets of each of six models.

A run with known parameters is measured with normal noise, anew for each data set, and fitted from
the truth. Of each unknown the interval is its value and 1.96 standard deviations on
either side, or the quantile of Student's t where the deviation of the measurements comes from the
residuals. Printed are how many of 100 hold the truth, of all unknowns together and of those that
do least and most often, how many standard deviations of a fit those of 200 data sets are, and how
many fits have a message. Run as ``python benchmarks/fit_coverage.py [model]``; all take three
minutes.
"""

import sys

import casadi as ca
import numpy as np
from report import publish
from scipy.stats import norm, t

import liouville as lv

SETS, LEVEL = 200, 0.95
SPRING = {"k": 40.0, "c": 0.3}
SIGMA = 2e-3


def oscillator():
    """Return a damped spring."""
    return lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2, q=("x",), params=SPRING,
        force=lambda t, q, v, params: -params.c * v,
    )  # fmt: skip


def pendulum():
    """Return a pendulum whose length is in its constraint."""
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1],
        lambda t, q, params: {"rod": ca.dot(q, q) - params.l**2},
        q=("x", "y"),
        params={"l": 1.0, "g": 9.81},
    )


def block():
    """Return a block on a spring with dry friction, and its turns, which end steps."""
    system = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2,
        q=("x",),
        params={"k": 40.0, "mu": 0.1},
        force=lambda t, q, v, params: -params.mu * 9.81 * ca.sign(v[0]),
    )
    turn = lv.Event(lambda t, q, v, lam, params: v[0], reset=lambda t, q, v, lam, params: {})
    return system, {"turn": turn}


def ball():
    """Return a ball that bounces, and its hits."""
    system = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - params.g * q[0],
        q=("x",),
        params={"g": 9.81, "e": 0.8},
    )
    hit = lv.Event(
        lambda t, q, v, lam, params: q[0],
        "down",
        reset=lv.Impact(lambda t, q, v, lam, params: params.e),
    )
    return system, {"floor": hit}


def cases():
    """Return by name a system, times, starts of its trials, and the arguments of its fit."""
    (block_of, turns), (ball_of, hits) = block(), ball()
    both = {"free": ("q", "v"), "sigma": SIGMA}
    rod = {"q": [0.6, -0.8], "v": [0.8, 0.6]}
    angle = {"angle": lambda t, q, v, params: ca.atan2(q[0], -q[1])}
    return {
        "damped spring and its start": (
            oscillator(), np.linspace(0, 2, 51), [{"q": [0.5], "v": [0.0]}],
            {"h": 0.04, "params": ("k", "c"), **both},
        ),
        "pendulum, 16 measurements, noise unknown": (
            pendulum(), np.linspace(0, 3, 16), [rod], {"h": 0.05, "params": ("l", "g")},
        ),
        "dry friction": (
            block_of, np.linspace(0, 1.6, 41), [{"q": [0.6], "v": [-0.8]}],
            {"h": 0.04, "params": ("k", "mu"), "events": turns, **both},
        ),
        "impacts": (
            ball_of, np.linspace(0, 1.5, 46), [{"q": [0.5], "v": [0.3]}],
            {"h": 0.05, "params": ("g", "e"), "events": hits, **both},
        ),
        "two trials": (
            oscillator(), np.linspace(0, 1.2, 31),
            [{"q": [0.5], "v": [0.0]}, {"q": [0.1], "v": [2.0]}],
            {"h": 0.04, "params": ("k", "c"), **both},
        ),
        "an angle at 40 times, with rtol=": (
            pendulum(), np.sort(np.random.default_rng(7).uniform(0.05, 3, 40)), [rod],
            {"rtol": 1e-8, "params": ("l",), "free": ("q", "v"), "sigma": SIGMA, "t0": 0.0,
             "observe": angle},
        ),
    }  # fmt: skip


def truth_of(system, times, start, call):
    """Return the measurements without noise, by name."""
    watched = {name: call[name] for name in ("events", "observe") if name in call}
    run = lv.integrate(
        system, lv.Spark(4), t=(0.0, times[-1]), h=0.01, t_eval=times, **watched, **start
    )
    if "observe" in call:
        return {name: x[:, 0] if x.ndim > 1 else x for name, x in run.observed.items()}
    return {"q": run.q}


def fits(system, times, starts, call):
    """Yield the fits of all data sets, with the true values of what is fitted."""
    clean = [truth_of(system, times, start, call) for start in starts]
    own, t0 = {x: y for x, y in call.items() if x != "t0"}, call.get("t0")
    for seed in range(SETS):
        rng = np.random.default_rng(seed)
        trials = [
            lv.Trial(
                {
                    "t": times,
                    **{x: y + SIGMA * rng.standard_normal(y.shape) for x, y in each.items()},
                },
                start,
                t0=t0,
            )
            for each, start in zip(clean, starts, strict=True)
        ]
        yield lv.fit(system, lv.Spark(3), trials, **own)


def true_values(system, starts):
    """Return the true values of parameters and starts by the names of a fit."""
    found = {f"params.{name}": value for name, value in system.params.items()}
    for k, start in enumerate(starts):
        prefix = f"trials[{k}]." if len(starts) > 1 else ""
        for state, values in start.items():
            each = zip(system.coordinates, values, strict=True)
            found |= {f"{prefix}{state}.{x}": value for x, value in each}
    return found


def row_of(name, system, times, starts, call):
    """Return how often intervals hold, how spreads compare, and how many fits say something."""
    known, side = true_values(system, starts), (1 + LEVEL) / 2
    inside, off, said = [], [], 0
    for found in fits(system, times, starts, call):
        misses = np.array([found.values[x] - known[x] for x in found.names])
        misses /= list(found.errors.values())
        width = norm.ppf(side) if found.sigma is None else t.ppf(side, found.dof)
        inside.append(np.abs(misses) < width)
        off.append(misses)
        said += bool(found.message)
    each = 100 * np.mean(inside, axis=0)
    return {
        "model": name,
        "unknowns": each.size,
        "held, %": round(each.mean(), 1),
        "of one, %": f"{each.min():.1f} to {each.max():.1f}",
        "spread / deviation": round(float(np.sqrt(np.mean(np.square(off)))), 2),
        "messages": said,
    }


def main():
    """Print a row for each model."""
    chosen = sys.argv[1:]
    found = cases().items()
    rows = [row_of(name, *case) for name, case in found if not chosen or name in chosen]
    publish("coverage", rows, columns=[name for name in rows[0] if name != "messages"])


if __name__ == "__main__":
    main()
