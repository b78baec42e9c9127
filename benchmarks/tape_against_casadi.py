"""Nanoseconds an instruction: the tape against CasADi's own virtual machine, on the same programs.

The programs are residual and sparse Jacobian of the equations of motion and their constraints for
a chain of ten links and for Andrews' mechanism, and a plain mix of additions and multiplications.
Both sides evaluate them at many points in one call that Python takes no part in; the values agree
but for the last bits of sines, and each time is the minimum of repeats taken in turn. An
instruction is one of the tape's, for both sides.

"lanes" is the tape eight points at a time; "f64" one at a time, which only the core's benchmark
reaches (``cargo bench``), on the plain mix. Run as ``python benchmarks/tape_against_casadi.py``.
"""

import json
import shutil
import subprocess
import time
from pathlib import Path

import casadi as ca
import numpy as np
from report import show

from liouville import problems
from liouville._systems.tape import record

POINTS = 1024
REPEATS = 600
SLOTS, INPUTS = 24, 16
ROOT = Path(__file__).resolve().parent.parent


def mechanics(system):
    """Return inputs and outputs of residual and Jacobian, from the system's own expressions."""
    s, model = system.symbols, system.model
    residual = ca.vertcat(model.p, model.f + model.r, model.g)
    jacobian = ca.jacobian(residual, ca.vertcat(s.y, s.z, model.lam))
    inputs = {**s.inputs(z=s.z), "lam": model.lam}
    inputs["params"] = inputs.pop("params")
    return inputs, ca.vertcat(residual, ca.vec(jacobian.nz[:]))


def averages(pairs=300):
    """Return the plain mix of the core's benchmark: half of sums and differences of 24 slots."""
    x = ca.SX.sym("x", INPUTS)
    slots = [x[k % INPUTS] for k in range(SLOTS)]
    state = 1

    def draw(most):
        nonlocal state
        state = (state * 6364136223846793005 + 1) % 2**64
        return (state >> 40) % most

    for _ in range(pairs):
        slot, other, choice = draw(SLOTS), draw(SLOTS), draw(2)
        sign = -1 if choice else 1
        slots[slot] = (slots[slot] + sign * slots[other]) * 0.5
    return {"x": x, "params": ca.SX(0, 1)}, ca.vertcat(*slots)


def casadi_machine(inputs, column, args, params):
    """Return a call that evaluates all points in CasADi, and the array it writes to."""
    function = ca.Function("f", list(inputs.values()), [ca.cse(column)]).map(POINTS)
    buffer, call = function.buffer()
    arrays = [*args, np.tile(params, (POINTS, 1))]
    for k, array in enumerate(arrays):
        buffer.set_arg(k, memoryview(array.ravel()))
    out = np.empty((POINTS, column.numel()))
    buffer.set_res(0, memoryview(out.ravel()))
    return call, out, (buffer, arrays, function)


def shortest(*calls):
    """Return the shortest time of each call, taken in turn, in nanoseconds."""
    best = [float("inf")] * len(calls)
    for _ in range(REPEATS):
        for k, call in enumerate(calls):
            begin = time.perf_counter_ns()
            call()
            best[k] = min(best[k], time.perf_counter_ns() - begin)
    return best


def compare(name, inputs, column, params):
    """Return the row of one program."""
    tape = record(name, inputs, column)
    random = np.random.default_rng(1)
    args = [random.uniform(0.5, 1.5, (POINTS, x.numel())) for x in list(inputs.values())[:-1]]
    call, out, _alive = casadi_machine(inputs, column, args, params)
    ours, theirs = shortest(lambda: tape.map(params, args), call)
    if not np.allclose(tape.map(params, args), out, rtol=1e-12, atol=1e-12):
        raise AssertionError(f"{name}: the tape and CasADi differ")
    return row(name, "lanes", len(tape), ours / POINTS, theirs / POINTS)


def row(program, scalar, instructions, ours, theirs):
    """Return a row from times of one evaluation at one point."""
    return {
        "program": program,
        "scalar": scalar,
        "instructions": instructions,
        "tape ns": round(ours / instructions, 3),
        "casadi ns": round(theirs / instructions, 3),
        "ratio": round(theirs / ours, 2),
    }


def f64_nanoseconds():
    """Run the core's benchmark of the plain mix; return its shortest time for an instruction."""
    command = ["cargo", "bench", "--quiet", "-p", "liouville-bench", "--bench", "kernels", "--"]
    command += ["tape/f64/arithmetic", "--noplot"]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    metadata = subprocess.run(
        ["cargo", "metadata", "--no-deps", "--format-version=1"],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    target = Path(json.loads(metadata.stdout)["target_directory"])
    result = target / "criterion" / "tape_f64" / "arithmetic" / "new"
    sample = json.loads((result / "sample.json").read_text())
    counted = json.loads((result / "benchmark.json").read_text())["throughput"]["Elements"]
    times = zip(sample["times"], sample["iters"], strict=True)
    return min(total / count for total, count in times) / counted


def main():
    rows = []
    for name in ("chain", "andrews"):
        system = problems.load(name).system
        rows.append(compare(name, *mechanics(system), system.values(None)))
    rows.append(compare("averages", *averages(), np.empty(0)))
    if shutil.which("cargo"):
        plain = rows[-1]
        count = plain["instructions"]
        f64, theirs = f64_nanoseconds(), plain["casadi ns"]
        rows.append(row("averages", "f64", count, f64 * count, theirs * count))
    show(rows)


if __name__ == "__main__":
    main()
