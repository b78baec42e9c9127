"""Contacts beside MuJoCo, Drake and Exudyn: where bodies end, how deep they sink in, and the time.

A block that slides to its stop, a ladder that leaves its wall, a toppling rod whose foot slips, an
elastic ball, and ten elastic discs in a box. Each code has discs on planes and on one another, from
the same description; others have them about as stiff as the step allows. Places at the end are
compared with Spark(6); how deep bodies sink in is the most of a hundred records, both in metres.
Times are minima of repeats taken in turn, on one thread, without set-up. Run as
``python benchmarks/contact_mechanisms.py``, after ``pip install --group bench``, and Drake where it
has a wheel: ``pip install drake``.
"""

import time
from functools import partial

import numpy as np
from peers import installed, touching
from report import publish

import liouville as lv
from liouville.bodies import Assembly, Plane, Sphere

RECORDS, REPEATS = 100, 6
OWN = ((lv.Spark(2), 0.05), (lv.Spark(3), 0.02))
EXACT = lv.Spark(6), 0.01


class Here:
    """A scene of the library."""

    def __init__(self, scene):
        self.scene = scene
        m = Assembly(gravity=(0, -scene.gravity, 0))
        walls = [Plane("ground", at=at, normal=normal) for at, normal in scene.planes]
        law = {"friction": scene.friction, "restitution": scene.restitution}
        rates, shapes = {}, []
        for k, body in enumerate(scene.bodies):
            x, y, angle = body.at
            weighs = {"mass": body.mass, "inertia": body.inertia}
            there = m.planar_body(f"{k}", at=(x, y), angle=angle, **weighs)
            m.free(f"flight {k}", there)
            vx, vy, spin = body.velocity
            rates[f"flight {k}"] = (vx, vy, None, None, None, spin)
            c, s = np.cos(angle), np.sin(angle)
            own = [
                Sphere(there, radius, at=(x + c * px - s * py, y + s * px + c * py))
                for px, py, radius in body.discs
            ]
            for n, disc in enumerate(own):
                for j, other in enumerate((*walls, *shapes)):
                    m.contact(f"{k}.{n} and {j}", disc, other, **law)
            shapes += own
        self.system, self.start = m.system(), m.start(rates=rates)

    def run(self, method, h):
        """Return seconds of a call, and places and angles of all bodies at a hundred times."""
        begin = time.perf_counter()
        found = lv.integrate(self.system, method, t=(0, self.scene.seconds), h=h, **self.start)
        seconds = time.perf_counter() - begin
        q = found(np.linspace(0, self.scene.seconds, RECORDS + 1)).q
        return seconds, q.reshape(len(q), -1, 3)


def rows_of(name, scene):
    """Return the rows of a scene."""
    here = Here(scene)
    _, exact = here.run(*EXACT)
    prepared = [(f"Spark({m.stages})", h, partial(here.run, m, h)) for m, h in OWN]
    prepared += list(installed("touching", scene, RECORDS))
    seconds, found, rows = {}, {}, []
    for _ in range(REPEATS):
        for k, (_, _, run) in enumerate(prepared):
            took, found[k] = run()
            seconds[k] = min(seconds.get(k, np.inf), took)
    for k, (code, h, _) in enumerate(prepared):
        off = found[k][-1, :, :2] - exact[-1, :, :2]
        rows.append(
            {
                "mechanism": name,
                "code": code,
                "h": h,
                "ms": 1e3 * seconds[k],
                "places off by": float(np.abs(off).max()),
                "sinks in by": float(max(0, -scene.gaps(found[k]).min())),
            }
        )
    return rows


def main():
    """Publish the table."""
    rows = [row for name, make in touching.SCENES.items() for row in rows_of(name, make())]
    publish("contact_mechanisms", rows, ["mujoco", "exudyn", "drake"])


if __name__ == "__main__":
    main()
