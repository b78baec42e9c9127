"""What holds for every system, on random ones: quadratic energies, quadratic constraints."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples

import liouville as lv
from liouville._systems.tape import record

FEW = examples(8)
STEPS, H = 12, 0.05


@dataclass(frozen=True)
class Random:
    """L = v M v / 2 + v B q - q K q / 2, and m constraints a x + x S x / 2 in x = q - q0."""

    mass: np.ndarray
    gyro: np.ndarray
    stiffness: np.ndarray
    gradients: np.ndarray
    curvatures: np.ndarray
    q0: np.ndarray
    v0: np.ndarray
    stages: int

    @property
    def m(self):
        return len(self.gradients)

    def constraint(self, q):
        x = q - ca.DM(self.q0)
        parts = [
            ca.dot(ca.DM(a), x) + ca.dot(x, ca.DM(S) @ x) / 2
            for a, S in zip(self.gradients, self.curvatures, strict=True)
        ]
        return ca.vertcat(ca.SX(0, 1), *parts)

    def lagrangian(self, q, v):
        M, B, K = ca.DM(self.mass), ca.DM(self.gyro), ca.DM(self.stiffness)
        return ca.dot(v, M @ v) / 2 + ca.dot(v, B @ q) - ca.dot(q, K @ q) / 2

    def system(self, constraint=None, change=None):
        """Return the system, its constraint or its coordinates written in another way."""
        n = len(self.q0)
        change = ca.DM(np.eye(n) if change is None else change)
        constraint = constraint or self.constraint
        return lv.Lagrangian(
            lambda t, q, v, params: self.lagrangian(change @ q, change @ v),
            lambda t, q, params: constraint(change @ q),
            q=n,
        )

    @property
    def start(self):
        start = {"q": self.q0, "v": self.v0}
        return self.system().consistent(hold="q", **start)

    def run(self, system, t=(0.0, STEPS * H), **start):
        return lv.integrate(system, lv.Spark(self.stages), t=t, steps=STEPS, **start)


def random(n, m, stages, seed):
    """Make up a system that is neither stiff nor near a singular position."""
    rng = np.random.default_rng(seed)
    root, square = rng.normal(size=(2, n, n))
    curvatures = 0.2 * rng.normal(size=(m, n, n))
    return Random(
        mass=np.eye(n) + root @ root.T / n,
        gyro=rng.normal(size=(n, n)),
        stiffness=square @ square.T,
        gradients=np.linalg.qr(rng.normal(size=(n, n)))[0][:m],
        curvatures=curvatures + curvatures.transpose(0, 2, 1),
        q0=rng.normal(size=n),
        v0=rng.normal(size=n),
        stages=stages,
    )


SEEDS, STAGES = st.integers(0, 2**32 - 1), st.integers(1, 4)


def systems(least=0):
    """Draw systems of two to four coordinates with at least so many constraints."""
    sizes = st.sampled_from([(n, m) for n in (2, 3, 4) for m in range(least, n)])
    return st.builds(lambda size, stages, seed: random(*size, stages, seed), sizes, STAGES, SEEDS)


def assert_close(one, two, digits):
    np.testing.assert_allclose(one, two, rtol=10.0**-digits, atol=10.0**-digits)


@FEW
@given(systems())
def test_both_constraints_hold_to_roundoff(model):
    solution = model.run(model.system(), **model.start)
    for residual in solution.residuals.values():
        assert np.abs(residual).max(initial=0) < 1e-14


@FEW
@given(systems())
def test_a_way_back_leads_back(model):
    system, start = model.system(), model.start
    there = model.run(system, **start)
    back = model.run(system, t=(STEPS * H, 0.0), q=there.q[-1], v=there.v[-1])
    assert_close(back.q[-1], start["q"], 13)
    assert_close(back.v[-1], start["v"], 13)


@FEW
@given(systems())
def test_lagrangian_and_hamiltonian_forms_are_one(model):
    B, K = ca.DM(model.gyro), ca.DM(model.stiffness)
    compliance = ca.DM(np.linalg.inv(model.mass))

    def hamiltonian(t, q, p, params):
        impulse = p - B @ q
        return ca.dot(impulse, compliance @ impulse) / 2 + ca.dot(q, K @ q) / 2

    conjugate = lv.Hamiltonian(
        hamiltonian, lambda t, q, params: model.constraint(q), q=len(model.q0)
    )
    one = model.run(model.system(), **model.start)
    two = model.run(conjugate, q=one.q[0], p=one.p[0])
    for name in ("q", "v", "p"):
        assert_close(one.states[name], two.states[name], 13)
    assert_close(one.lam, two.lam, 11)


@FEW
@given(systems(least=1), SEEDS)
def test_only_the_zeros_of_a_constraint_matter(model, seed):
    mixing = np.eye(model.m) + np.tril(np.random.default_rng(seed).normal(size=(model.m, model.m)))
    mixing += np.sign(np.diag(mixing)) * np.eye(model.m)

    def other(q):
        g = ca.DM(mixing) @ model.constraint(q)
        return ca.exp(g) - 1 + g**2

    start = model.start
    one, two = model.run(model.system(), **start), model.run(model.system(other), **start)
    assert_close(one.q, two.q, 13)
    assert_close(one.v, two.v, 13)
    assert_close(one.lam, two.lam @ mixing, 10)


@FEW
@given(st.floats(-3, 3), st.floats(-1, 1), STAGES)
def test_a_length_and_its_square_are_the_same_constraint(angle, height, stages):
    side = np.sqrt(1 - 0.81 * height**2)
    start = {
        "q": [side * np.cos(angle), side * np.sin(angle), 0.9 * height],
        "v": [-np.sin(angle), np.cos(angle), 0],
    }

    def pendulum(length):
        return lv.Lagrangian(
            lambda t, q, v, params: ca.dot(v, v) / 2 - q[2],
            lambda t, q, params: length(q),
            q=("x", "y", "z"),
        )

    one, two = (
        lv.integrate(pendulum(length), lv.Spark(stages), t=(0, 1), h=H, **start)
        for length in (lambda q: (ca.dot(q, q) - 1) / 2, lambda q: ca.norm_2(q) - 1)
    )
    assert_close(one.q, two.q, 13)
    assert_close(one.v, two.v, 13)


@FEW
@given(systems(least=1))
@example(random(2, 1, stages=1, seed=3))
@example(random(3, 1, stages=2, seed=0))  # it passes through zero
def test_how_the_multiplier_enters_does_not_matter(model):
    n = len(model.q0)
    B, K = ca.DM(model.gyro), ca.DM(model.stiffness)

    def general(scale):
        return lv.Mechanical(
            velocity=lambda t, y, z, params: z,
            momentum=lambda t, y, z, params: ca.DM(model.mass) @ z + B @ y,
            force=lambda t, y, z, params: B.T @ z - K @ y,
            reaction=lambda t, y, lam, params: -ca.jtimes(model.constraint(y), y, scale(lam), True),
            constraint=lambda t, y, params: model.constraint(y),
            y=n,
        )

    start = dict(zip(("y", "z"), model.start.values(), strict=True))
    plain = model.run(general(lambda lam: lam), **start)
    bent = model.run(general(lambda lam: 2 * lam + ca.tanh(lam)), **start)
    assert_close(plain.y, bent.y, 13)
    assert_close(plain.z, bent.z, 13)
    assert_close(plain.lam, 2 * bent.lam + np.tanh(bent.lam), 11)


@FEW
@given(systems(), SEEDS)
def test_coordinates_may_be_permuted_or_mixed(model, seed):
    rng, n = np.random.default_rng(seed), len(model.q0)
    one = model.run(model.system(), **model.start)
    for change in (np.eye(n)[rng.permutation(n)], np.eye(n) + 0.3 * rng.uniform(size=(n, n)) / n):
        start = {name: np.linalg.solve(change, x) for name, x in model.start.items()}
        two = model.run(model.system(change=change), **start)
        assert_close(one.q, two.q @ change.T, 12)
        assert_close(one.v, two.v @ change.T, 12)
        assert_close(one.lam, two.lam, 10)


# sin, cos, asinh, acosh and atanh are the core's own; all others are the C library's on both sides
UNARY = (
    *(ca.exp, ca.log, ca.sqrt, ca.tan, ca.asin, ca.acos, ca.atan),
    *(ca.sinh, ca.cosh, ca.tanh, ca.log1p, ca.expm1, ca.floor, ca.ceil, ca.fabs, ca.sign),
    *(ca.logic_not, lambda x: -x, lambda x: 1 / x, lambda x: x * x, lambda x: 2 * x),
)
BINARY = (
    *(lambda x, y: x + y, lambda x, y: x - y, lambda x, y: x * y, lambda x, y: x / y),
    *(lambda x, y: x**y, ca.fmod, ca.atan2, ca.hypot, ca.fmin, ca.fmax),
    lambda x, y: ca.copysign(x, ca.fmax(y, -9)),  # no sign is promised of a nan
    *(lambda x, y: x < y, lambda x, y: x <= y, lambda x, y: x == y, lambda x, y: x != y),
    *(ca.logic_and, ca.logic_or, lambda x, y: ca.if_else(x, y, 0)),
)
OPERATIONS = [(f, 1) for f in UNARY] + [(f, 2) for f in BINARY]


@examples(100)
@given(
    lines=st.lists(
        st.tuples(st.integers(0, len(OPERATIONS) - 1), st.integers(0, 99), st.integers(0, 99)),
        min_size=1,
        max_size=24,
    ),
    constant=st.floats(-10, 10),
    seed=SEEDS,
)
@example(lines=[(k, 0, 1) for k in range(len(OPERATIONS))], constant=0.5, seed=0)
def test_a_tape_has_the_values_of_the_function_it_records(lines, constant, seed):
    x, y, c = ca.SX.sym("x", 2), ca.SX.sym("y"), ca.SX.sym("c")
    values = [x[0], x[1], y, c, ca.SX(constant)]
    for code, i, j in lines:
        function, arity = OPERATIONS[code]
        operands = (values[i % len(values)], values[j % len(values)])[:arity]
        value = function(*operands)
        values.append(x[0] if value.is_constant() else value)  # a constant may be nan, and refused
    outputs = ca.vertcat(*values[5:])

    rng = np.random.default_rng(seed)
    special = rng.choice([0.0, -0.0, 1.0, -1.0, np.inf, 1e-310, 1e200, -0.5], size=(11, 3))
    points = np.where(rng.uniform(size=(11, 3)) < 0.2, special, 2 * rng.normal(size=(11, 3)))
    tape = record("random", {"x": x, "y": y, "params": c}, outputs)
    ours = tape.map(np.array([0.75]), [points[:, :2].copy(), points[:, 2:].copy()])
    function = ca.Function("f", [x, y, c], [outputs])
    theirs = np.array([function(p[:2], p[2], 0.75).full().ravel() for p in points])
    same = (ours.view(np.int64) == theirs.view(np.int64)) | (np.isnan(ours) & np.isnan(theirs))
    assert same.all()
