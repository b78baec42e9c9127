"""Spin systems beside QuTiP: building, products and time, and drives as samples.

One thread, seconds of the processor, the least of three runs where they are short. QuTiP makes
operators by tensor products, and runs the integrator and tolerance of those below that reach the
error with the least time.
"""

import time

import numpy as np
import qutip
from peers.wave import QuTiP
from report import publish

import liouville as lv

ERROR, SPAN, FIELD = 1e-6, 10.0, 0.7
SETTINGS = [(name, 10.0**-k) for name in ("adams", "dop853", "krylov") for k in (7, 8, 9)]


def timed(function, repeats=3):
    """Return the least time of some calls, and the last result."""
    best = np.inf
    for _ in range(repeats):
        begin = time.process_time()
        found = function()
        best = min(best, time.process_time() - begin)
        if best > 5:
            break
    return best, found


def models(length):
    """Return the systems by name, the start and the state of their frame."""
    ising = [("zz", -1.0), ("x", -FIELD)]
    exchange = [("xx", 1.0), ("yy", 1.0), ("zz", 0.5), ("z", 0.3 * np.cos(np.arange(length)))]
    return {
        "Ising": lambda: lv.SpinSystem(length, ising, pauli=True),
        "XXZ": lambda: lv.SpinSystem(length, exchange),
        "XXZ, sector": lambda: lv.SpinSystem(length, exchange, up=length // 2),
    }


def theirs(length, name):
    """Return QuTiP's Hamiltonian, made by tensor products."""
    one = qutip.qeye(2)
    own = {"x": qutip.sigmax(), "y": qutip.sigmay(), "z": qutip.sigmaz()}

    def on(letter, *sites):
        # site 0 has the fastest digit here
        parts = [own[letter] if i in sites else one for i in range(length)]
        return qutip.tensor(parts[::-1])

    pairs = [(i, i + 1) for i in range(length - 1)]
    if name == "Ising":
        return -sum(on("z", *p) for p in pairs) - FIELD * sum(on("x", i) for i in range(length))
    total = sum(c / 4 * on(a, *p) for p in pairs for a, c in (("x", 1), ("y", 1), ("z", 0.5)))
    return total + sum(0.15 * np.cos(i) * on("z", i) for i in range(length))


def chains():
    """Publish building, products and times for chains."""
    rows = []
    for length in (10, 12, 14):
        for name, make in models(length).items():
            building, system = timed(lambda make=make: lv.Schrodinger(make()))
            spins = system.source
            psi = np.zeros(spins.size)
            psi[spins.index([k % 2 for k in range(length)])] = 1.0
            method = lv.Chebyshev(tol=ERROR)
            plan = lv.plan(system, method, t=(0, SPAN), psi=psi)
            own, run = timed(
                lambda s=system, p=plan, y=psi: lv.integrate(s, p, t=(0, SPAN), psi=y, threads=1)
            )
            row = {"H": name, "spins": length, "states": spins.size, "built s": building}
            row |= {"QuTiP built s": None, "products": run.stats["products"], "run s": own}
            row |= {"QuTiP products": None, "QuTiP run s": None, "QuTiP / run": None}
            if length <= 14 and "sector" not in name:
                exact = lv.integrate(system, lv.Chebyshev(tol=1e-11), t=(0, SPAN), psi=psi).psi[-1]
                row["QuTiP built s"], hamiltonian = timed(lambda n=length, w=name: theirs(n, w), 1)
                matrix, best = hamiltonian.data.as_scipy(), np.inf
                for integrator, tolerance in SETTINGS:
                    is_counted = integrator != "krylov"  # it takes no H(t), which counts
                    counting = QuTiP(matrix, psi, SPAN, integrator, counted=is_counted)
                    _, found = counting.run(tolerance)
                    if np.linalg.norm(found - exact) > ERROR:
                        continue
                    code = QuTiP(matrix, psi, SPAN, integrator, counted=False)
                    seconds, _ = timed(lambda c=code, x=tolerance: c.run(x), 1)
                    if seconds < best:
                        best = seconds
                        row |= {"QuTiP run s": seconds, "QuTiP / run": seconds / own}
                        row["QuTiP products"] = counting.products or None
            rows.append(row)
    publish("spin_systems", rows, ("qutip",), [key for key in rows[0] if key != "QuTiP products"])


def samples():
    """Print the products of a pulse as a formula and as samples."""
    print("\n| samples | " + " | ".join(f"{tol:.0e}" for tol in (1e-4, 1e-6, 1e-8)) + " |")
    chain = lv.SpinSystem(8, [("zz", -1.0)], pauli=True)
    transverse, psi = chain.operator("x", -1.0), chain.product_state([1.0, 0.0])
    for count in (None, 51, 201, 801):
        at = np.linspace(0, 4, count or 2)
        pulse = (lambda t, params: np.sin(t) ** 2) if count is None else np.sin(at) ** 2
        system = lv.Schrodinger(chain, drive=[(pulse, transverse)], times=at)
        runs = [
            lv.integrate(system, lv.Chebyshev(tol=tol), t=(0, 4), psi=psi)
            for tol in (1e-4, 1e-6, 1e-8)
        ]
        print("|", count or "formula", "|", " | ".join(str(r.stats["products"]) for r in runs), "|")


if __name__ == "__main__":
    chains()
    samples()
