"""Loops, energy and time of three mechanisms with closed loops, beside MuJoCo, Exudyn and Drake.

A four-bar of spatial hinges and Bricard's mechanism, whose loops hold more than they need, and a
Stewart platform. MuJoCo closes loops by equality constraints, as stiff as the step allows. Loops
are relative to a metre, energies to the largest kinetic energy, both the worst of a hundred
records; places at the end are compared with Spark(6), in metres. Times are minima of repeats taken
in turn, on one thread, without set-up. Run as ``python benchmarks/mechanisms.py``, after
``pip install --group bench``, and Drake where it has a wheel: ``pip install drake``.
"""

from functools import partial

import numpy as np
from peers import installed, loops
from report import publish, show

import liouville as lv
from liouville.bodies import rotations as rot

RECORDS, REPEATS = 100, 2
OWN = ((lv.Spark(2), 0.01), (lv.Spark(3), 0.01), (lv.Spark(4), 0.02))
EXACT = lv.Spark(6), 0.01


class Here:
    """A model read by the library."""

    def __init__(self, model):
        self.model = model
        assembly = lv.bodies.from_mjcf(loops.mjcf(model))
        self.system = assembly.system()
        self.start = assembly.start(rates=model.rates)

    def run(self, method, h):
        """Return seconds and the motion of all bodies."""
        steps = round(self.model.seconds / h)
        span = {"t": (0.0, self.model.seconds), "steps": steps, "every": steps // RECORDS}
        found = lv.integrate(self.system, method, **span, **self.start)
        return found.stats["seconds"], motion(found, self.model)


def motion(found, model):
    """Return places, turns since the start, velocities and angular velocities."""
    bodies = [found.body(link.name) for link in model.links]
    turns = []
    for body in bodies:
        since = rot.product(body.rotation.T, rot.conjugate(body.rotation[0]))
        turns.append(np.moveaxis(np.array(rot.columns(since)), (0, 1, 2), (2, 1, 0)))
    x, v, omega = (
        np.stack([getattr(body, name) for body in bodies], axis=1)
        for name in ("position", "velocity", "angular_velocity")
    )
    return x, np.stack(turns, axis=1), v, omega


def rows_of(name, model):
    """Return the rows of a mechanism."""
    gauge, here = loops.Gauge(model), Here(model)
    _, exact = here.run(*EXACT)
    begin = [part[0] for part in exact]
    prepared = [(f"Spark({m.stages})", h, partial(here.run, m, h)) for m, h in OWN]
    prepared += list(installed("loops", model, begin, RECORDS))
    seconds, motions, rows = {}, {}, []
    for _ in range(REPEATS):
        for k, (_, _, run) in enumerate(prepared):
            took, motions[k] = run()
            seconds[k] = min(seconds.get(k, np.inf), took)
    for k, (code, h, _) in enumerate(prepared):
        x, turns, v, omega = motions[k]
        rows.append(
            {
                "mechanism": name,
                "code": code,
                "h": h,
                "ms": 1e3 * seconds[k],
                "loops off by": gauge.gap(x, turns),
                "energy off by": gauge.energy(x, turns, v, omega),
                "places off by": float(np.abs(x[-1] - exact[0][-1]).max()),
            }
        )
    return rows


def main():
    """Publish the table."""
    rows = [row for name, make in loops.MODELS.items() for row in rows_of(name, make())]
    show(rows)
    print()
    loop = [row for row in rows if row["mechanism"] == "Bricard"]
    publish("mechanisms", loop, ["mujoco", "mujoco-core", "exudyn", "drake"])


if __name__ == "__main__":
    main()
