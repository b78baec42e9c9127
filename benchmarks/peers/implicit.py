"""A mechanical system as a first-order implicit equation 0 = F(t, x, x'), compiled from C.

That is what the general DAE codes take. CasADi differentiates and writes the C, the system's
compiler makes a library of it; parameters are numbers in it. The forms, with the equations of
motion M v' = f + r(lam) in each and w = g_t + g_q v:

``index1``   q' = v and w' = 0, in q, v, lam
``index2``   q' = v and w = 0
``ggl``      q' = v - g_q^T mu and both g = w = 0, in q, v, lam, mu (Gear, Gupta, Leimkuhler)
``integral`` the same, its multipliers the derivatives of the unknowns, which makes it index 1
"""

import ctypes
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import casadi as ca
import numpy as np

ENTRIES = """
static double work[{size}];
void residual(double t, const double* x, const double* xp, double* out) {{
    const double* arg[] = {{&t, x, xp}};
    residual_(arg, &out, 0, work, 0);
}}
void jacobian(double t, double cj, const double* x, const double* xp, double* out) {{
    const double* arg[] = {{&t, &cj, x, xp}};
    jacobian_(arg, &out, 0, work, 0);
}}
void parts(double t, const double* x, const double* xp, double* by_x, double* by_xp) {{
    const double* arg[] = {{&t, x, xp}};
    double* res[] = {{by_x, by_xp}};
    parts_(arg, res, 0, work, 0);
}}

extern double* N_VGetArrayPointer(void*);
extern double* SUNDenseMatrix_Data(void*);
extern double* SUNSparseMatrix_Data(void*);
extern int* SUNSparseMatrix_IndexPointers(void*);
extern int* SUNSparseMatrix_IndexValues(void*);
static const int columns[] = {{{columns}}}, rows[] = {{{rows}}};
enum {{ SIZE = sizeof columns / sizeof *columns - 1, COUNT = sizeof rows / sizeof *rows }};
int ida_residual(double t, void* x, void* xp, void* out, void* data) {{
    residual(t, N_VGetArrayPointer(x), N_VGetArrayPointer(xp), N_VGetArrayPointer(out));
    return 0;
}}
int ida_dense(double t, double cj, void* x, void* xp, void* res, void* matrix) {{
    double values[COUNT], *out = SUNDenseMatrix_Data(matrix);
    jacobian(t, cj, N_VGetArrayPointer(x), N_VGetArrayPointer(xp), values);
    for (int j = 0; j < SIZE; j++)
        for (int k = columns[j]; k < columns[j + 1]; k++) out[j * SIZE + rows[k]] = values[k];
    return 0;
}}
int ida_sparse(double t, double cj, void* x, void* xp, void* res, void* matrix) {{
    int *starts = SUNSparseMatrix_IndexPointers(matrix);
    int *indices = SUNSparseMatrix_IndexValues(matrix);
    for (int j = 0; j <= SIZE; j++) starts[j] = columns[j];
    for (int k = 0; k < COUNT; k++) indices[k] = rows[k];
    jacobian(t, cj, N_VGetArrayPointer(x), N_VGetArrayPointer(xp), SUNSparseMatrix_Data(matrix));
    return 0;
}}
"""

FORMS = ("index1", "index2", "ggl", "integral")


@dataclass(frozen=True)
class Implicit:
    """One system in one form; `state` and `rate` are x and x' as symbols, `rows` is F."""

    name: str
    time: ca.SX
    state: ca.SX
    rate: ca.SX
    rows: ca.SX
    start: tuple[np.ndarray, np.ndarray]
    n: int

    @property
    def algebraic(self):
        """Indices of the unknowns whose derivative F does not depend on."""
        pattern = ca.jacobian_sparsity(self.rows, self.rate)
        return [k for k in range(self.state.numel()) if pattern.colind(k) == pattern.colind(k + 1)]

    def jacobians(self):
        """Return F_x and F_x'."""
        return ca.jacobian(self.rows, self.state), ca.jacobian(self.rows, self.rate)

    def jacobian(self, cj):
        """Return F_x + cj F_x', what the multistep codes factor."""
        by_state, by_rate = self.jacobians()
        return by_state + cj * by_rate

    @cached_property
    def library(self):
        """Compile ``residual(t, x, x', F)``, ``jacobian(t, cj, x, x', nonzeros)`` and ``parts``.

        ``parts(t, x, x', nonzeros, nonzeros)`` are those of F_x and F_x'.
        """
        cj = ca.SX.sym("cj")
        t, x, xp = self.time, self.state, self.rate
        return compiled(
            ca.Function("residual_", [t, x, xp], [self.rows]),
            ca.Function("jacobian_", [t, cj, x, xp], [self.jacobian(cj)]),
            ca.Function("parts_", [t, x, xp], list(self.jacobians())),
            source=ENTRIES,
            columns=", ".join(map(str, self.sparsity[0])),
            rows=", ".join(map(str, self.sparsity[1])),
        )

    @cached_property
    def sparsity(self):
        """Row and column numbers of F_x + cj F_x' by columns: (indptr, indices)."""
        pattern = self.jacobian(ca.SX.sym("cj")).sparsity()
        return np.array(pattern.colind(), np.int32), np.array(pattern.row(), np.int32)

    def split(self, x):
        """Return the coordinates and velocities in x."""
        return np.array(x[: self.n]), np.array(x[self.n : 2 * self.n])


def compiled(*functions, source, **fields):
    """Write functions as C, compile them with `source`, and load the library."""
    folder = Path(tempfile.mkdtemp(prefix="peer-"))
    generator = ca.CodeGenerator("peer.c", {"with_header": False, "casadi_int": "int"})
    for function in functions:
        generator.add(function)
    generator.generate(f"{folder}/")
    size = max(function.sz_w() for function in functions) + 1
    with (folder / "peer.c").open("a", encoding="utf-8") as code:
        code.write(source.format(size=size, **fields))
    target = folder / "peer.so"
    flags = ["-O2", "-march=native", "-fPIC", "-shared"]
    subprocess.run(["cc", *flags, "-o", target, folder / "peer.c", "-lm"], check=True)
    return ctypes.CDLL(str(target))


def pointer(array):
    return array.ctypes.data_as(ctypes.c_void_p)


def equations(system, params=None):
    """Return the system's symbols and expressions with numbers, or symbols, for its parameters.

    They are t, q, v, lam, its mass matrix, force, reaction, g and w.
    """
    s, model = system.symbols, system.model
    t, q, v = s.t, s.y, s.z
    along = ca.vertcat(t, q), ca.vertcat(1, v)
    mass = ca.jacobian(model.p, v)
    force = model.f - ca.jtimes(model.p, *along)
    hidden = ca.jtimes(model.g, *along)
    found = mass, force, model.r, model.g, hidden
    numbers = ca.DM(system.values(None)) if params is None else params
    return t, q, v, model.lam, *(ca.substitute(x, s.params.vector, numbers) for x in found)


def accelerations(system):
    """Return a function (t, q, v) -> (v', lam) from M v' = f + r(lam), w' = 0."""
    t, q, v, lam, mass, force, reaction, _, hidden = equations(system)
    by_lam, by_v = ca.jacobian(reaction, lam), ca.jacobian(hidden, v)
    m = lam.numel()
    matrix = ca.vertcat(ca.horzcat(mass, -by_lam), ca.horzcat(by_v, ca.SX(m, m)))
    rest = -ca.jtimes(hidden, ca.vertcat(t, q), ca.vertcat(1, v))
    known = ca.Function("known", [t, q, v], [ca.densify(matrix), ca.vertcat(force, rest)])

    def solve(*at):
        a, b = (np.array(x) for x in known(*at))
        found = np.linalg.solve(a, b[:, 0])
        return found[: v.numel()], found[v.numel() :]

    return solve


def implicit(system, form, start, t0):
    """Bring a system to a form, with a consistent start."""
    t, q, v, lam, mass, force, reaction, g, hidden = equations(system)
    n, m = q.numel(), lam.numel()
    qp, vp = ca.SX.sym("qp", n), ca.SX.sym("vp", n)
    q0, v0 = (np.array(start[name], dtype=float) for name in "qv")
    a0, lam0 = accelerations(system)(t0, q0, v0)
    motion = ca.mtimes(mass, vp) - force - reaction
    none = np.zeros(m)
    if form in ("index1", "index2"):
        last = hidden
        if form == "index1":
            last = ca.jtimes(hidden, ca.vertcat(t, q, v), ca.vertcat(1, v, vp))
        rows = ca.vertcat(qp - v, motion, last)
        state, rate = ca.vertcat(q, v, lam), ca.vertcat(qp, vp, ca.SX.sym("lamp", m))
        points = (q0, v0, lam0), (v0, a0, none)
    else:
        mu = ca.SX.sym("mu", m)
        projected = qp - v + ca.mtimes(ca.jacobian(g, q).T, mu)
        rows = ca.vertcat(projected, motion, hidden, g)
        others = ca.SX.sym("other", 2 * m)
        multipliers = ca.vertcat(lam, mu)
        state, rate = ca.vertcat(q, v), ca.vertcat(qp, vp)
        if form == "ggl":
            state, rate = ca.vertcat(state, multipliers), ca.vertcat(rate, others)
            points = (q0, v0, lam0, none), (v0, a0, none, none)
        else:
            state, rate = ca.vertcat(state, others), ca.vertcat(rate, multipliers)
            points = (q0, v0, none, none), (v0, a0, lam0, none)
    x0, xp0 = (np.concatenate(parts) for parts in points)
    return Implicit(form, t, state, rate, rows, (x0, xp0), n)
