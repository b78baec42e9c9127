"""Steps that are large for a force that turns: the solution is the one that begins at h = 0.

The reference follows the equations of a method from h = 0 in numpy, by parts so short that
Newton's method is nearly linear in each and its matrix keeps the sign of its determinant: there is
no fold, and one branch.
"""

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville import _core

POTENTIALS = {
    "waves": lambda q, k: q[1] + k * ca.cos(10 * q[0]) * ca.cos(7 * q[1]),
    "ripples": lambda q, k: (
        q[1] + 1.5 * ca.sumsqr(q) + 1e-3 * k * ca.cos(40 * q[1]) * ca.cos(31 * q[0])
    ),
    "spring": lambda q, k: q[1] + k / 2 * (ca.norm_2(q) - 1) ** 2,
    "quartic": lambda q, k: k / 4 * (ca.sumsqr(q) - 1) ** 2 + q[1],
    "atoms": lambda q, k: k * (ca.sumsqr(q) ** -6 - 2 * ca.sumsqr(q) ** -3),
    "morse": lambda q, k: k * (1 - ca.exp(-3 * (ca.norm_2(q) - 1))) ** 2,
    "wall": lambda q, k: k * ca.exp(-5 * q[1]) + 9.8 * q[1] + q[0] ** 2 / 2,
}
#: Roots of the largest stiffness, in those of k.
FREQUENCIES = {"waves": 10, "ripples": 1.3, "atoms": 6, "morse": 6}


def system(name, wire=None):
    """Return a mass in a potential, and its force and stiffness as a function of (q, k)."""
    potential = POTENTIALS[name]
    moves = lv.Lagrangian(
        lambda t, q, v, p: ca.sumsqr(v) / 2 - potential(q, p.k), wire, q=2, params={"k": 1.0}
    )
    q, k = ca.SX.sym("q", 2), ca.SX.sym("k")
    force = -ca.gradient(potential(q, k), q)
    found = ca.Function("force", [q, k], [force, ca.jacobian(force, q)])
    return moves, lambda q, k: [np.asarray(value).squeeze() for value in found(q, k)]


def with_varying_mass(name):
    """Return a system of varying mass, and p, f and their slopes as a function of (q, k) and v."""
    q, v, k = ca.SX.sym("q", 2), ca.SX.sym("v", 2), ca.SX.sym("k")

    def lagrangian(q, v, k):
        mass = 1 + q[0] ** 2 / 2 + ca.sin(3 * q[1]) / 4
        return mass * ca.sumsqr(v) / 2 - POTENTIALS[name](q, k)

    moves = lv.Lagrangian(lambda t, q, v, p: lagrangian(q, v, p.k), q=2, params={"k": 1.0})
    both = [ca.gradient(lagrangian(q, v, k), by) for by in (v, q)]
    slopes = [ca.jacobian(value, by) for value in both for by in (q, v)]
    found = ca.Function("found", [q, v, k], [*both, *slopes])
    return moves, lambda q, k: lambda v: [np.asarray(x).squeeze() for x in found(q, v, k)]


class Stages:
    """The stage equations of a SPARK method, in the velocities of the stages."""

    def __init__(self, count):
        at = _core.spark_tableau(count, "gauss")
        self.a_v, self.a_f, self.b = at["a_v"], at["a_f"], at["b"]

    def start(self, q, v, force):
        return np.tile(v, len(self.b))

    def end(self, x, q, v, h):
        return q + h * self.b @ x.reshape(-1, 2)

    def residual(self, force, x, q, v, h):
        z = x.reshape(-1, 2)
        at = [force(y) for y in q + h * self.a_v @ z]
        values = (z - v - h * self.a_f @ [f for f, _ in at]).ravel()
        matrix = np.eye(len(x))
        for (_, slope), into, of in zip(at, self.a_f.T, self.a_v, strict=True):
            matrix -= h**2 * np.kron(np.outer(into, of), slope)
        return values, matrix


class StagesOfMass(Stages):
    """The same with a mass that varies."""

    def residual(self, force, x, q, v, h):
        z, a_v, a_f = x.reshape(-1, 2), self.a_v, self.a_f
        at = [force(y)(u) for y, u in zip(q + h * a_v @ z, z, strict=True)]
        p, f, p_q, p_v, f_q, f_v = (np.array(values) for values in zip(*at, strict=True))
        matrix = h * np.einsum("ij,iab->iajb", a_v, p_q) - h * np.einsum("ij,jab->iajb", a_f, f_v)
        matrix -= h**2 * np.einsum("il,lj,lab->iajb", a_f, a_v, f_q)
        matrix[range(len(z)), :, range(len(z))] += p_v
        return (p - force(q)(v)[0] - h * a_f @ f).ravel(), matrix.reshape(len(x), len(x))


class Bead:
    """The stage equations of a SPARK method for a bead on y = cos 3x, in Z and h lambda."""

    def __init__(self, count):
        at = _core.spark_tableau(count, "gauss")
        self.a_v, self.a_f, self.a_bar, self.b = at["a_v"], at["a_f"], at["a_bar"], at["b"]
        self.a_hat = at["a_hat"][:, :-1]

    def start(self, q, v, force):
        return np.concatenate([np.tile(v, len(self.b)), np.zeros(self.a_hat.shape[1])])

    def end(self, x, q, v, h):
        return q + h * self.b @ x[: 2 * len(self.b)].reshape(-1, 2)

    def residual(self, force, x, q, v, h):
        s = len(self.b)
        z, lam = x[: 2 * s].reshape(-1, 2), x[2 * s :]
        nodes = q + h * self.a_bar @ z
        across = np.column_stack([3 * np.sin(3 * nodes[:, 0]), np.ones(len(nodes))])
        pushes, at = lam[:, None] * across[:-1], [force(y) for y in q + h * self.a_v @ z]
        off = (nodes[:, 1] - np.cos(3 * nodes[:, 0]))[1:] / h
        momenta = z - v - h * self.a_f @ [f for f, _ in at] - self.a_hat @ pushes
        of_z = np.eye(2 * s)
        for (_, slope), into, of in zip(at, self.a_f.T, self.a_v, strict=True):
            of_z -= h**2 * np.kron(np.outer(into, of), slope)
        for k, size in enumerate(lam):
            bend = np.diag([9 * size * np.cos(3 * nodes[k, 0]), 0])
            of_z -= h * np.kron(np.outer(self.a_hat[:, k], self.a_bar[k]), bend)
        of_lam = [np.kron(self.a_hat[:, k], across[k]) for k in range(len(lam))]
        of_g = [np.kron(self.a_bar[k + 1], across[k + 1]) for k in range(len(lam))]
        none = np.zeros((len(lam), len(lam)))
        matrix = np.block([[of_z, -np.column_stack(of_lam)], [np.array(of_g), none]])
        return np.concatenate([momenta.ravel(), off]), matrix


class Alpha:
    """The equations of a generalised alpha method from rest of its accelerations, in phi_1."""

    def __init__(self, alpha_m, alpha_f):
        self.beta = (1 - alpha_m + alpha_f) ** 2 / 4
        self.old = 0.5 - self.beta + self.beta * (alpha_f - alpha_m) / (1 - alpha_m)
        self.new = self.beta * (1 - alpha_f) / (1 - alpha_m)

    def start(self, q, v, force):
        self.first = force(q)[0]
        return self.first

    def end(self, x, q, v, h):
        return q + h * v + h**2 * (self.old * self.first + self.new * x)

    def residual(self, force, x, q, v, h):
        value, slope = force(self.end(x, q, v, h))
        return x - value, np.eye(2) - h**2 * self.new * slope


METHODS = {
    "midpoint": (lv.Spark(1), Stages(1)),
    "gauss": (lv.Spark(2), Stages(2)),
    "hht": (lv.HHT(-0.1), Alpha(0.0, 0.1)),
    "alpha": (lv.GeneralizedAlpha(0.8), Alpha(1 / 3, 4 / 9)),
}


def newton(residual, x, h, sign):
    """Return the solution from x, or None where corrections are not as those of a straight path."""
    first = last = None
    for _ in range(8):
        value, matrix = residual(x, h)
        try:
            d = np.linalg.solve(matrix, -value)
        except np.linalg.LinAlgError:
            return None
        x, size, unit = x + d, np.abs(d).max(), max(np.abs(x).max(), 1e-3)
        if last is None:
            first = size
        elif last is first and first > 1e-8 * unit and size > 0.05 * first:
            return None
        stalls = last is not None and last is not first and size >= 0.3 * last
        if size <= 1e-13 * unit or (stalls and size < 1e-8 * unit):
            return x if sign * np.linalg.det(residual(x, h)[1]) > 0 else None
        last = size
    return None


def followed(residual, x, h):
    """Return the solution on the branch that begins at x for h = 0, or None where it folds."""
    done, part, before = 0.0, h / 64, None
    sign = np.sign(np.linalg.det(residual(x, 1e-9 * h)[1]))
    while done < h:
        there = min(done + part, h)
        ahead = 0.0 if before is None else (x - before[0]) * (there - done) / (done - before[1])
        found = newton(residual, x + ahead, there, sign)
        if found is not None and before is not None:
            off, moved = np.abs(found - x - ahead).max(), np.abs(found - x).max()
            found = found if off <= 0.3 * moved + 1e-7 * np.abs(found).max() else None
        if found is None:
            part = (there - done) / 2
            if part < 1e-9 * h:
                return None
            continue
        before, x, done, part = (x, done), found, there, 1.4 * part
    return x


def steps(name, seed, count):
    """Return k, h, q and v of random large steps."""
    rng = np.random.default_rng([seed, *map(ord, name)])
    for _ in range(count):
        k = 10 ** rng.uniform(0, 7)
        h = 10 ** rng.uniform(-0.3, 1.0) / (FREQUENCIES.get(name, 1.5) * np.sqrt(k))
        angle, r = rng.uniform(0, 2 * np.pi), 1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-4, -0.7)
        q = rng.uniform(-1, 1, 2) if name in ("waves", "ripples") else r * np.r_[
            np.cos(angle), np.sin(angle)]  # fmt: skip
        yield k, h, q, rng.normal(size=2) * 10 ** rng.uniform(-3, 0.7)


def judged(of, method, equations, cases):
    """Return how many solutions are on the branch, and where one is not or none was found."""
    moves, force = of
    same, other, refused = 0, [], []
    for k, h, q, v in cases:
        run = {"t": (0, h), "steps": 1, "q": q, "v": v, "params": {"k": k}}
        try:
            found = lv.integrate(moves, method, **run).q[-1]
        except lv.IntegrationError:
            found = None

        def own(y, k=k):
            return force(y, k)

        def residual(x, h, own=own, q=q, v=v):
            return equations.residual(own, x, q, v, h)

        right = followed(residual, equations.start(q, v, own), h)
        if right is None:
            continue
        if found is None:
            refused.append((k, h, q, v))
            continue
        off = np.abs(found - equations.end(right, q, v, h)).max()
        if off > 1e-7 * (np.abs(q).max() + h * np.abs(v).max()):
            other.append((k, h, q, v, off))
        else:
            same += 1
    return same, other, refused


#: Numbers of steps in `steps(name, 1, 40)` that had solutions on other branches.
HARD = [
    ("ripples", "midpoint", (7, 22, 25, 34)),
    ("ripples", "gauss", (13,)),
    ("ripples", "hht", (7, 22, 30)),
]
#: Two steps of the midpoint rule in waves; other branches have the determinants -0.13 and -1.3e3.
REPORTED = [
    (9313.24507015566, 0.0027147211264470943, [0.04366511975183162, 0.9991151283832678],
     [-0.0054326856027615686, 0.011908419693770978]),
    (5.319023129366249, 0.622026324674323, [0.04185746473289128, 1.0460707963333593],
     [0.3856041312388212, -3.4812681363512747]),
]  # fmt: skip


@pytest.mark.parametrize(("name", "of", "which"), HARD)
def test_a_force_that_turns_leads_to_no_other_branch(name, of, which):
    cases = list(steps(name, 1, 40))
    same, other, refused = judged(system(name), *METHODS[of], [cases[k] for k in which])
    assert not other
    assert same == len(which), refused


def test_the_reported_steps_are_on_their_branch():
    cases = [(k, h, np.array(q), np.array(v)) for k, h, q, v in REPORTED]
    same, other, _ = judged(system("waves"), *METHODS["midpoint"], cases)
    assert (same, other) == (2, [])


@pytest.mark.parametrize("of", METHODS)
@pytest.mark.parametrize("name", ["waves", "spring", "atoms"])
def test_a_large_step_is_solved_on_its_branch(name, of):
    same, other, refused = judged(system(name), *METHODS[of], steps(name, 2, 10))
    assert (same > 0, other, refused) == (True, [], [])


#: Numbers of steps in `steps(name, 3, 60)` that had solutions on other branches with a mass that
#: varies, and how many stages the method has.
VARYING = [
    ("waves", 1, (6, 14, 46, 50)),
    ("ripples", 1, (4, 17, 27, 53, 55, 56, 57)),
    ("ripples", 2, (27, 41, 55)),
]


@pytest.mark.parametrize(("name", "stages", "which"), VARYING)
def test_a_mass_that_varies_leads_to_no_other_branch(name, stages, which):
    of, method, all_steps = with_varying_mass(name), lv.Spark(stages), list(steps(name, 3, 60))
    cases = [all_steps[k] for k in which]
    same, other, refused = judged(of, method, StagesOfMass(stages), cases)
    assert not other
    assert same == len(which), refused
    for k, h, q, v in cases:
        run = {"t": (0, h), "steps": 1, "params": {"k": k}}
        alone = lv.integrate(of[0], method, **run, q=q, v=v)
        members = lv.ensemble(of[0], method, **run, q=np.tile(q, (8, 1)), v=np.tile(v, (8, 1)))
        assert np.all(members.q[-1] == alone.q[-1])


def wire(t, q, p):
    return q[1] - ca.cos(3 * q[0])


def bead(k, h, x, speed):
    """Return k, h, q and v of a bead on the wire."""
    q = np.array([x, np.cos(3 * x)])
    return k, h, q, speed * np.array([1, -3 * np.sin(3 * x)])


#: Steps of a bead that had solutions on other branches, with the stages of the method.
BEADS = [
    ("waves", 1, (47491.920509090065, 0.0015876579932927691,
                  0.02333836515115295, -0.0176073994898077)),
    ("waves", 1, (3142583.3727134205, 0.00030953063194739163,
                  0.3511802573902296, 0.002634504271522004)),
    ("ripples", 1, (1109589.2131289367, 0.0028013854316898787,
                    -0.06285217786894637, -0.02934174524392747)),
    ("ripples", 2, (1213.1420683550855, 0.2095126732050337,
                    -0.9437687676631819, 0.25470990439506264)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "stages", "case"), BEADS)
def test_a_constrained_step_is_solved_on_its_branch(name, stages, case):
    of = system(name, wire)
    same, other, refused = judged(of, lv.Spark(stages), Bead(stages), [bead(*case)])
    assert (same, other, refused) == (1, [], [])


@pytest.mark.parametrize("method", [lv.HHT(-0.1), lv.GeneralizedAlpha(0.8), lv.ArnoldBruls(0.8)])
def test_a_constrained_step_of_the_alpha_family_is_joined_to_shorter_ones(method):
    k, h, q, v = bead(*BEADS[1][2])
    moves, _ = system("waves", wire)
    ends = [q]
    for part in np.linspace(0, 1, 401)[1:]:
        run = {"t": (0, part * h), "steps": 1, "q": q, "v": v, "params": {"k": k}}
        ends.append(lv.integrate(moves, method, **run).q[-1])
    assert np.abs(np.diff(ends, axis=0)).max() < 0.02
