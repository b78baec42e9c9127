"""SUNDIALS IDA twice: through scikit-sundae, and its library called from C alone.

scikit-sundae calls back into Python for each residual; here the callback is compiled by numba and
goes straight to the compiled equations. Without Python the same library (scikit-sundae's wheel
holds it) evaluates the same equations: that is what IDA can do. Multipliers are left out of the
error test, in scikit-sundae by an absolute tolerance of 1e30, as it has no such option.
"""

import ctypes
import time
from ctypes import byref, c_double, c_int, c_long, c_void_p
from pathlib import Path

import numba
import numpy as np
import scipy.sparse as sp
import sksundae

from .implicit import pointer

LIBRARIES = [
    "core",
    "nvecserial",
    "sunmatrixdense",
    "sunmatrixsparse",
    "sunlinsoldense",
    "sunlinsolsuperlumt",
    "ida",
]
IGNORED = 1e30
MOST_STEPS = 200_000


def libraries():
    """Load the SUNDIALS libraries of scikit-sundae's wheel, for all to see."""
    folder = Path(sksundae.__file__).parent.parent / "scikit_sundae.libs"
    return {
        key: ctypes.CDLL(str(next(folder.glob(f"libsundials_{key}-*"))), ctypes.RTLD_GLOBAL)
        for key in LIBRARIES
    }


def tolerances(equation, scales, tol):
    """Return absolute tolerances of coordinates, velocities and multipliers."""
    parts = (scales[0], equation.n), (scales[1], equation.n)
    atol = np.concatenate([np.full(count, tol * scale) for scale, count in parts])
    rest = len(equation.start[0]) - atol.size
    return np.append(atol, np.full(rest, IGNORED))


class InC:
    """IDA with residual and Jacobian in C, dense or sparse (SuperLU_MT on one thread)."""

    def __init__(self, equation, span, scales, sparse=False):
        self.equation, self.span, self.scales = equation, span, scales
        lib = libraries()
        self.ida, core = lib["ida"], lib["core"]
        self.context = c_void_p()
        core.SUNContext_Create(0, byref(self.context))
        core.SUNContext_ClearErrHandlers(self.context)
        x0, _ = equation.start
        size = len(x0)
        self.x, self.xp, self.atol = np.empty(size), np.empty(size), np.ones(size)
        kind = 1.0 - np.isin(np.arange(size), equation.algebraic)
        make = lib["nvecserial"].N_VMake_Serial
        make.restype = c_void_p
        make.argtypes = [c_int, c_void_p, c_void_p]
        self.vectors = [
            c_void_p(make(size, pointer(array), self.context))
            for array in (self.x, self.xp, self.atol, kind)
        ]
        x, xp, atol, kind = self.vectors
        code = equation.library
        _, rows = equation.sparsity
        if sparse:
            new, arguments = lib["sunmatrixsparse"].SUNSparseMatrix, (size, size, len(rows), 0)
            solver, jacobian = lib["sunlinsolsuperlumt"].SUNLinSol_SuperLUMT, code.ida_sparse
            threads = (1,)
        else:
            new, arguments = lib["sunmatrixdense"].SUNDenseMatrix, (size, size)
            solver, jacobian = lib["sunlinsoldense"].SUNLinSol_Dense, code.ida_dense
            threads = ()
        new.restype = solver.restype = self.ida.IDACreate.restype = c_void_p
        matrix = c_void_p(new(*arguments, self.context))
        linear = c_void_p(solver(x, matrix, *threads, self.context))
        self.memory = c_void_p(self.ida.IDACreate(self.context))
        self.x[:], self.xp[:] = equation.start
        ida, memory = self.ida, self.memory
        check(ida.IDAInit(memory, code.ida_residual, c_double(span[0]), x, xp))
        check(ida.IDASVtolerances(memory, c_double(1e-6), atol))
        check(ida.IDASetLinearSolver(memory, linear, matrix))
        check(ida.IDASetJacFn(memory, jacobian))
        check(ida.IDASetId(memory, kind))
        if equation.algebraic:
            check(ida.IDASetSuppressAlg(memory, 1))
        check(ida.IDASetMaxNumSteps(memory, c_long(MOST_STEPS)))

    def run(self, tol):
        """Integrate with a relative tolerance, absolute in units of the scales."""
        ida, memory = self.ida, self.memory
        x, xp, atol, _ = self.vectors
        self.atol[:] = tolerances(self.equation, self.scales, tol)
        self.x[:], self.xp[:] = self.equation.start
        check(ida.IDASVtolerances(memory, c_double(tol), atol))
        reached = c_double()
        begin = time.perf_counter()
        check(ida.IDAReInit(memory, c_double(self.span[0]), x, xp))
        check(ida.IDASetStopTime(memory, c_double(self.span[1])))
        flag = ida.IDASolve(memory, c_double(self.span[1]), byref(reached), x, xp, 1)
        seconds = time.perf_counter() - begin
        check(flag)
        return seconds, *self.equation.split(self.x)

    def counts(self):
        """Return how often the last run stepped, evaluated and factored."""
        names = {"steps": "NumSteps", "residuals": "NumResEvals", "factorizations": "NumJacEvals"}
        found = {}
        for key, name in names.items():
            count = c_long()
            check(getattr(self.ida, f"IDAGet{name}")(self.memory, byref(count)))
            found[key] = count.value
        return found


def check(flag):
    if flag < 0:
        raise RuntimeError(f"IDA returned {flag}")


class ScikitSundae:
    """IDA through scikit-sundae."""

    def __init__(self, equation, span, scales, sparse=False):
        self.equation, self.span, self.scales = equation, span, scales
        self.residual, self.jacobian = callbacks(equation, sparse)
        self.options = {"linsolver": "dense"}
        if sparse:
            columns, rows = equation.sparsity
            size = len(columns) - 1
            pattern = sp.csc_matrix((np.ones(len(rows)), rows, columns), shape=(size, size))
            self.options = {"linsolver": "sparse", "sparsity": pattern, "nthreads": 1}

    def run(self, tol):
        """Integrate with a relative tolerance, absolute in units of the scales."""
        solver = sksundae.ida.IDA(
            self.residual,
            jacfn=self.jacobian,
            rtol=tol,
            atol=tolerances(self.equation, self.scales, tol),
            algebraic_idx=self.equation.algebraic or None,
            max_num_steps=MOST_STEPS,
            **self.options,
        )
        begin = time.perf_counter()
        found = solver.solve(
            np.linspace(*self.span, 3), *self.equation.start
        )  # of two it keeps all steps
        seconds = time.perf_counter() - begin
        if not found.success:
            raise RuntimeError(found.message)
        return seconds, *self.equation.split(found.y[-1])


def callbacks(equation, sparse):
    """Return residual and Jacobian as scikit-sundae calls them, compiled by numba."""
    code = equation.library
    code.residual.argtypes = [c_double, c_void_p, c_void_p, c_void_p]
    code.jacobian.argtypes = [c_double, c_double, c_void_p, c_void_p, c_void_p]
    code.residual.restype = code.jacobian.restype = None
    c_residual, c_jacobian = code.residual, code.jacobian
    columns, rows = equation.sparsity
    count = len(rows)

    @numba.njit
    def fast_residual(t, y, yp, res):
        c_residual(t, y.ctypes, yp.ctypes, res.ctypes)

    @numba.njit
    def fast_sparse(t, y, yp, cj, out):
        c_jacobian(t, cj, y.ctypes, yp.ctypes, out.ctypes)

    @numba.njit
    def fast_dense(t, y, yp, cj, out):
        values = np.empty(count)
        c_jacobian(t, cj, y.ctypes, yp.ctypes, values.ctypes)
        for j in range(len(columns) - 1):
            for k in range(columns[j], columns[j + 1]):
                out[rows[k], j] = values[k]

    fast = fast_sparse if sparse else fast_dense

    def residual(t, y, yp, res):
        fast_residual(t, y, yp, res)

    def jacobian(t, y, yp, res, cj, out):
        fast(t, y, yp, cj, out)

    return residual, jacobian
