"""Random scenes of discs and boxes in a bin, whose records are held to the laws of contact."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville._runs.contacts import Mode

G = 9.81
WALLS = {"floor": (0.0, 1.0, 0.0), "left": (1.0, 0.0, -1.5), "right": (-1.0, 0.0, -1.5)}

#: Of the bin: gaps are known to roundings of it.
WIDTH = 3.0


class Scene:
    """Bodies with a point or corners, each a disc of a radius, which may be zero."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.n = n = int(rng.integers(3, 7))
        self.rest, self.mu = float(rng.choice([0, 0.2, 0.5])), float(rng.choice([0.1, 0.3, 0.6]))
        self.features, self.inertias = [], []
        for _ in range(n):
            a, is_disc = rng.uniform(0.12, 0.25), rng.random() < 0.5
            b = a * rng.uniform(0.5, 1)
            corners = [((i * a, j * b), 0.0) for i in (1, -1) for j in (1, -1)]
            self.features.append([((0.0, 0.0), a)] if is_disc else corners)
            self.inertias.append(a**2 / 2 if is_disc else (a**2 + b**2) / 3)
        places = np.linspace(-1.1, 1.1, n)
        rng.shuffle(places)
        height, angle = 0.35 + rng.uniform(0, 0.25, n), rng.uniform(-0.5, 0.5, n)
        if n > 5:  # which would overlap side by side
            height += 0.6 * (np.argsort(np.argsort(places)) % 2)
        self.start = {"q": np.ravel(np.column_stack([places, height, angle]))}
        self.start["v"] = rng.normal(size=3 * n)
        self.laws = {}
        for k in range(n):
            for i, own in enumerate(self.features[k]):
                for name, wall in WALLS.items():
                    self.laws[f"{k}.{i} {name}"] = self.on_wall(k, own, wall)
                for j in range(k):
                    for m, other in enumerate(self.features[j]):
                        if own[1] + other[1] > 0:
                            self.laws[f"{k}.{i} {j}.{m}"] = self.on_body(k, own, j, other)
        contacts = {
            name: lv.Contact(
                lambda t, q, params, law=law: law(q, 0 * q)[0],
                self.rest,
                self.mu,
                slip=lambda t, q, v, params, law=law: law(q, v)[1],
            )
            for name, law in self.laws.items()
        }
        self.system = lv.Lagrangian(
            lambda t, q, v, params: self.kinetic(v) - G * sum(q[1 + 3 * k] for k in range(n)),
            q=3 * n,
            contacts=contacts,
        )

    def kinetic(self, v):
        masses = np.ravel([(1.0, 1.0, J) for J in self.inertias])
        return sum(m * v[k] ** 2 for k, m in enumerate(masses)) / 2

    @staticmethod
    def place(q, k, own):
        c, s = ca.cos(q[3 * k + 2]), ca.sin(q[3 * k + 2])
        return q[3 * k] + c * own[0] - s * own[1], q[3 * k + 1] + s * own[0] + c * own[1]

    @staticmethod
    def moved(q, v, k, at):
        """Return the velocity of the point of body k that is at a place."""
        return (
            v[3 * k] - v[3 * k + 2] * (at[1] - q[3 * k + 1]),
            v[3 * k + 1] + v[3 * k + 2] * (at[0] - q[3 * k]),
        )

    def on_wall(self, k, own, wall):
        (point, radius), (nx, ny, off) = own, wall

        def law(q, v):
            x, y = self.place(q, k, point)
            u = self.moved(q, v, k, (x - radius * nx, y - radius * ny))
            return nx * x + ny * y - off - radius, ny * u[0] - nx * u[1]

        return law

    def on_body(self, k, own, j, other):
        (point, radius), (beside, space) = own, other

        def law(q, v):
            a, b = self.place(q, k, point), self.place(q, j, beside)
            length = ca.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)
            nx, ny = (a[0] - b[0]) / length, (a[1] - b[1]) / length
            at = b[0] + space * nx, b[1] + space * ny
            u, w = self.moved(q, v, k, at), self.moved(q, v, j, at)
            return length - radius - space, ny * (u[0] - w[0]) - nx * (u[1] - w[1])

        return law

    def rates(self):
        """Return gaps, slips, rates and accelerations of gaps by (q, v, N, T), from the laws."""
        size = 3 * self.n
        q, v = ca.SX.sym("q", size), ca.SX.sym("v", size)
        N, T = ca.SX.sym("N", len(self.laws)), ca.SX.sym("T", len(self.laws))
        gaps, slips = (
            ca.vertcat(*x) for x in zip(*(x(q, v) for x in self.laws.values()), strict=True)
        )
        rate = ca.jtimes(gaps, q, v)
        force = ca.jtimes(gaps, q, N, True) + ca.jtimes(slips, v, T, True)
        weight = np.tile([0.0, -G, 0.0], self.n)
        a = (force + weight) / np.ravel([(1.0, 1.0, J) for J in self.inertias])
        across = ca.jtimes(rate, ca.vertcat(q, v), ca.vertcat(v, a))
        return ca.Function("rates", [q, v, N, T], [gaps, slips, rate, across])


def is_held_to_the_laws(scene, run):
    records = list(run.contacts.values())
    N, T = (np.array([getattr(x, name) for x in records]) for name in ("normal", "friction"))
    modes = np.array([[int(mode) for mode in x.mode] for x in records])
    found = scene.rates().map(len(run.t))(run.q.T, run.v.T, N, T)
    gap, slip, rate, across = (np.array(x) for x in found)
    strong = max(1.0, abs(N).max())
    assert gap.min() > -1e-14 * WIDTH
    assert N.min() > -1e-11 * strong
    assert abs(N * gap).max() < 1e-12 * strong
    assert (abs(T) <= scene.mu * N + 1e-10 * strong).all()
    slips = np.isin(modes, [Mode.SLIP_UP, Mode.SLIP_DOWN])
    against = np.where(modes == Mode.SLIP_UP, 1, -1)
    assert abs(T + scene.mu * against * N)[slips].max(initial=0) < 1e-12 * strong
    assert (slip * against)[slips].min(initial=0) > -1e-7
    assert abs(slip[modes == Mode.STICK]).max(initial=0) < 1e-11
    closed = modes != Mode.OPEN
    assert abs(across[closed]).max(initial=0) < 1e-9 * strong
    # one that is higher may be in a flight as low as roundings of the bin
    assert across[(gap < 4e-15) & (abs(rate) < 1e-11)].min(initial=0) > -1e-8 * strong
    assert np.diff(run.invariants["energy"]).max() < 1e-9 * strong


def ends(seed, **steps):
    scene = Scene(seed)
    run = lv.integrate(scene.system, lv.Spark(3), t=(0, 1.2), **scene.start, **steps)
    assert sum(len(record.changes) for record in run.contacts.values()) > 5
    is_held_to_the_laws(scene, run)


#: Scenes with a disc at rest in a corner, whose margin is zero, with a box that lies down on an
#: edge of which both corners bear as much as friction, with a force of -4e-12 that holds on,
#: with a disc that presses itself against two corners of a box or rolls between them, with a
#: contact that closes 6e-12 above another one, with a mode that has no step of .02 at its end, and
#: with a low flight that friction jams where it is closed.
AT_EDGES = [70039, 70046, 80369, 44, 80405, 80329, 80339, 99]


@pytest.mark.parametrize("seed", [*range(4), *AT_EDGES])
def test_a_scene_obeys_the_laws_at_every_record(seed):
    ends(seed, h=0.02)


def test_a_scene_obeys_the_laws_with_controlled_steps():
    ends(1, rtol=1e-9)


@pytest.mark.slow
def test_of_many_scenes_none_breaks_the_laws_and_few_are_refused():
    refused = []
    for seed in range(4, 504):
        try:
            ends(seed, h=0.02)
        except lv.IntegrationError as error:
            refused.append(f"{seed}: {error}")
    assert len(refused) <= 5, refused
