"""Programs that are printed are those that run: read as they stand, they give the core's values."""

import math
import re

import casadi as ca
import mpmath
import numpy as np
import pytest

import liouville as lv
from liouville._systems.program import SHOWN
from liouville._systems.tape import record
from liouville.problems import chain, fekete, pendulum

OPERATIONS = {
    "assign": lambda a: a,
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "sq": lambda a: a * a,
    "twice": lambda a: a + a,
    "inv": lambda a: 1.0 / a,
    "sqrt": math.sqrt,
    "lt": lambda a, b: float(a < b),
    "search": lambda x, column: float(np.searchsorted(column, x, side="right")),
    "entry": lambda k, column: float(column[int(k)]),
}
LINE = re.compile(r"(.+) = (\w+)\((.*)\)")


def read(program, inputs):
    """Run the lines of a program; returns its outputs."""
    held = dict(zip(program.inputs, inputs, strict=True))

    held |= {f"columns[{k}]": column for k, column in enumerate(program.columns)}

    def value(name):
        return held[name] if name in held else float(name)

    for line in (*program.once, *program.each):
        out, operation, operands = LINE.fullmatch(line).groups()
        held[out] = OPERATIONS[operation](*map(value, re.split(r", (?![\d,]*\])", operands)))
    return np.array([held[name] for name in program.outputs])


ROAD = lv.table([0.0, 0.5, 0.7, 1.2, 2.0], [0.0, 0.3, -0.1, 0.2, 0.0])
DRIVEN = lv.Lagrangian(lambda t, q, v, p: v[0] ** 2 / 2 - (q[0] - ROAD(t)) ** 2 * ROAD(q[0]), q=1)
SYSTEMS = {
    "pendulum": pendulum.system,
    "chain": chain.build(70),
    "fekete": fekete.system,
    "table": DRIVEN,
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_program_read_line_by_line_gives_the_values_of_its_tape(name):
    system = SYSTEMS[name]
    rng, params = np.random.default_rng(3), system.values(None)
    for tape, core in system.tapes.items():
        args = [rng.uniform(0.5, 1.5, (1, size)) for size in core.inputs[:-1]]
        wanted = core.map(params, args)[0]
        program = system.tape(tape)
        found = read(program, [*np.concatenate(args, axis=1)[0], *params])
        assert found.tobytes() == wanted.tobytes(), tape
        assert len(program) == len(core)


def test_a_part_has_what_leads_to_it_and_the_same_values():
    system, params = SYSTEMS["chain"], SYSTEMS["chain"].values(None)
    core = system.tapes["stage"]
    args = [np.random.default_rng(3).uniform(0.5, 1.5, (1, size)) for size in core.inputs[:-1]]
    n = len(system.coordinates)
    force, stage = system.tape("force"), system.tape("stage")
    found = read(force, [*np.concatenate(args, axis=1)[0], *params])
    assert found.tobytes() == core.map(params, args)[0][n : 2 * n].tobytes()
    assert set(force.each) < set(stage.each)


def test_a_program_prints_inputs_by_the_names_of_the_user():
    assert str(pendulum.system.tape("constraint")) == (
        "constraint, of node: 5 operations for constraint[0]\n"
        "  once a run:\n"
        "    r10 = sq(params.l)\n"
        "  each time:\n"
        "    r14 = sq(q[0])\n"
        "    r15 = sq(q[1])\n"
        "    r18 = add(r14, r15)\n"
        "    r21 = sub(r18, r10)\n"
        "    constraint[0] = div(r21, 2.0)"
    )
    assert "energy = " in str(pendulum.system.tape("observer"))


def test_parameters_multipliers_and_matrices_have_names():
    mass = np.diag([1.0, 2.0, 3.0])
    stiffness = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
    system = lv.Structure(mass, stiffness=stiffness)
    text = str(system.tape("force"))
    assert "force += -1.0 * A q, A 3 by 3 with 7 entries" in text
    assert "momentum" not in text
    system = lv.SemiExplicit(
        field=lambda t, y, z, params: (y[1] * params.k[1], z[0] - y[0]),
        constraint=lambda t, y, params: y[1] - t, y=2, z=1, params={"k": [1.0, 2.0]},
    )  # fmt: skip
    assert "field[0] = mul(y[1], params.k[1])" in str(system.tape("field"))
    assert "lam[0]" in str(pendulum.system.tape("reaction"))


def test_an_unknown_tape_is_refused_with_those_that_there_are():
    with pytest.raises(
        ValueError, match=r"no tape 'forces'; there are stage, .*observer\n"
    ) as error:
        pendulum.system.tape("forces")
    assert "hint: or name a part of one: momentum, force," in str(error.value)


def test_a_long_program_is_printed_in_part_and_kept_whole():
    program = chain.build(400).tape("node_blocks")
    lines = str(program).splitlines()
    assert len(program.each) > 2 * SHOWN > len(lines) - 10
    assert any(line.strip().startswith("... and ") for line in lines)


def test_roundings_bound_those_of_an_evaluation_and_little_more():
    """In whatever unit, also where terms cancel, beside the exact value of the same program."""

    def made(x, y, sqrt, sin, atan2):
        return [x * y - x / y, sqrt(x) - (x - y) ** 2, sin(x * y) + 3 * x, atan2(x, y) - x / y]

    x = ca.SX.sym("x", 2)
    program = ca.vertcat(*made(x[0], x[1], ca.sqrt, ca.sin, ca.atan2))
    tape = record("program", {"x": x, "params": ca.SX(0, 1)}, program)
    random = np.random.default_rng(1)
    for _ in range(200):
        at = 10.0 ** random.uniform(-12, 3, 2)
        with mpmath.workdps(60):
            exact = made(*map(mpmath.mpf, at), mpmath.sqrt, mpmath.sin, mpmath.atan2)
            values = tape.map(np.empty(0), [at[None]])[0]
            errors = np.array([float(abs(a - b)) for a, b in zip(values, exact, strict=True)])
        bounds = tape.roundings(np.empty(0), [at])
        assert (errors <= bounds).all()
        sizes = np.array([at.prod() + at[0] / at[1], np.sqrt(at[0]) + at.max() ** 2])
        assert (bounds[:2] < 32 * np.finfo(float).eps * sizes).all()
    with pytest.raises(ValueError, match="inputs have sizes"):
        tape.roundings(np.empty(0), [at[:1]])
