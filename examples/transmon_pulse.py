"""
A pi pulse against leakage
==========================

A transmon is an oscillator whose levels are not quite equally spaced. A short pulse that takes it
from the ground state to the next one reaches the level above too, as its spectrum is broad. Which
pulse of 6 ns leaves nothing there? Gradients of the fidelity by all samples of the pulse take one
call, however many there are: this is GRAPE of Khaneja, Reiss, Kehlet, Schulte-Herbrueggen and
Glaser (2005). What it finds is confirmed by a run whose error is bounded beforehand.
"""

# %%
# In the frame that rotates with the first transition, three levels have one energy, the
# anharmonicity of -300 MHz, and two quadratures of a drive, here in radians per nanosecond. They
# are splines through samples, zero at both ends.

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import minimize

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

lower = np.diag(np.sqrt([1.0, 2.0]), 1)
energies = np.diag([0.0, 0.0, -2 * np.pi * 0.3])
drives = [(lower + lower.T) / 2, 0.5j * (lower.T - lower)]
times = np.linspace(0, 6, 25)
zero, one = np.eye(3, dtype=complex)[:2]


def transmon(pulse):
    samples = np.pad(np.reshape(pulse, (2, -1)), ((0, 0), (1, 1)))
    return lv.Schrodinger(
        energies, drive=list(zip(samples, drives, strict=True)), times=times
    )


# %%
# The infidelity is that of the normalised state: an optimiser would find any step that makes the
# state longer. Its cotangent is the derivative by the last state.


def infidelity(pulse, tol=1e-8):
    by = ["drive[0]", "drive[1]"]
    solution, pullback = lv.vjp(
        transmon(pulse), lv.Chebyshev(tol), wrt=by, t=(0, 6), psi=zero
    )
    psi = solution.psi[-1]
    norm, others = np.vdot(psi, psi).real, psi * [1, 0, 1]
    missing = np.vdot(others, others).real / norm
    cotangent = np.zeros_like(solution.psi)
    cotangent[-1] = 2 * (others - missing * psi) / norm
    gradient = pullback(psi=cotangent)
    return missing, np.concatenate([gradient[name][1:-1] for name in by])


# %%
# A pulse in the shape of a bell, with the area of a half turn, misses by a tenth.

bell = np.exp(-(((times[1:-1] - 3) / 1.5) ** 2))
first = np.concatenate([np.pi * bell / (bell.sum() * 0.25), np.zeros(23)])
print(f"infidelity of the bell: {infidelity(first)[0]:.1e}")

# %%
# L-BFGS-B takes gradients, and bounds: amplitudes are limited in the laboratory, and unlimited ones
# would lead to ever shorter windows.

found = minimize(
    infidelity,
    first,
    jac=True,
    method="L-BFGS-B",
    bounds=[(-1.5, 1.5)] * first.size,
    options={"maxiter": 200, "ftol": 0, "gtol": 1e-9},
)
print(
    f"infidelity: {found.fun:.1e} after {found.nit} iterations and {found.nfev} gradients"
)

# %%
# An infidelity is worth no more than its run. Of a run without derivatives it is known beforehand
# that the state is off by 1e-8 at most: so are the amplitudes of the other levels, and the
# infidelity is below 1e-15 for certain. A tolerance of 1e-12 confirms it.

run = lv.integrate(transmon(found.x), lv.Chebyshev(1e-8), t=(0, 6), psi=zero)
bound, others = run.stats["bound"], np.linalg.norm(run.psi[-1, [0, 2]])
print(f"bound of the error: {bound:.0e}, of the infidelity: {(others + bound) ** 2:.1e}")
print(f"infidelity at a tolerance of 1e-12: {infidelity(found.x, 1e-12)[0]:.1e}")

# %%
# The second quadrature follows the slope of the first one, and the level above is empty at the end.

t = np.linspace(0, 6, 241)
fig, (top, below) = plt.subplots(2, 1, sharex=True, figsize=(7, 5))
for pulse, style in ((first, ":"), (found.x, "-")):
    for k, samples in enumerate(np.pad(pulse.reshape(2, -1), ((0, 0), (1, 1)))):
        top.plot(t, lv.table(times, samples, ends="not-a-knot")(t), style, color=f"C{k}")
    run = lv.integrate(transmon(pulse), lv.Chebyshev(1e-8), t=t, psi=zero)
    for level, colour in ((1, "C2"), (2, "C3")):
        below.plot(t, abs(run.psi[:, level]) ** 2, style, color=colour)
top.set_ylabel("amplitude in rad/ns")
below.set_xlabel("time in ns")
below.set_ylabel("populations of 1 and 2")
plt.show()
