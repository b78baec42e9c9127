"""Error against work for every composition: which one is best for 1e-4, 1e-6, 1e-9, 1e-12.

Work is the number of times a step goes through the pieces, there or back, times the number of
steps; it knows no machine. Each problem is split the same way for all schemes; errors are the
largest differences from a run of order 10 with small steps, relative to the largest component. Work
at an error is interpolated in powers.

Run as ``python benchmarks/compositions.py``; takes a minute. Draws build/measured/compositions.png.
"""

import matplotlib.pyplot as plt
import numpy as np
from precision import seconds_at
from report import FOLDER, show

import liouville as lv
from liouville import problems
from liouville._methods import composition

#: Names and lengths of the runs.
PROBLEMS = {
    "bajer_moffatt": 2.0,
    "hill_vortex": 4.0,
    "euler_top": 10.0,
    "volterra_lattice": 5.0,
    "toda_lattice": 5.0,
    "lorenz96": 2.0,
    "euler2d": 2.0,
    "sabra": 1.0,
    "maxwell_bloch": 5.0,
    "cubic_charge": 5.0,
    "abc_flow": 5.0,
}
SCHEMES = {name: found for name, found in composition.SCHEMES.items() if found["order"] > 1}
LEVELS = (1e-4, 1e-6, 1e-9, 1e-12)
WORK = tuple(int(40 * 2 ** (k / 3)) for k in range(31))  # 40 to 40960
REFERENCE = (60_000, 80_000)  # work of the runs that the others are held against


def sweeps(scheme):
    """Return how many times a step of a scheme goes through the pieces."""
    return len(SCHEMES[scheme]["flows"])


def end(problem, scheme, steps, span):
    """Return the state at the end of a run."""
    method = lv.VolumeSplitting("exponentials", "natural", composition=scheme, compensated=True)
    found = lv.integrate(
        problem.system, method, t=(0.0, span), steps=steps, every=steps, **problem.start
    )
    return found.x[-1]


def study(name, span):
    """Return for each scheme its runs as work and error."""
    problem = problems.load(name)
    coarse, fine = (end(problem, "SS10s35", work // sweeps("SS10s35"), span) for work in REFERENCE)
    scale = np.abs(fine).max()
    print(f"{name}: two references differ by {np.abs(coarse - fine).max() / scale:.1e}")
    found = {}
    for scheme in SCHEMES:
        runs = []
        for steps in sorted({max(1, round(work / sweeps(scheme))) for work in WORK}):
            try:
                error = np.abs(end(problem, scheme, steps, span) - fine).max() / scale
            except lv.IntegrationError:  # so long a step blows up
                continue
            runs.append((error, steps * sweeps(scheme)))
        found[scheme] = runs
    return found


def settled(runs):
    """Return errors and work of the runs from where no finer one is worse, the coarsest first.

    An error that happens to be small says nothing about the scheme.
    """
    kept, largest = [], 1e-17
    for error, work in reversed(runs):
        largest = max(largest, error)
        kept.append((largest, work))
    return np.array(kept[::-1])


def work_at(error, runs):
    """Return the work for an error, not a number where the runs do not reach it."""
    return seconds_at(error, settled(runs))


def tables(results):
    """Return the work of each scheme for each problem and error, and its mean ratio to the best."""
    rows, means = [], []
    for error in LEVELS:
        own = {}
        for name, found in results.items():
            work = {scheme: work_at(error, runs) for scheme, runs in found.items()}
            rows.append({"problem": name, "error": error, **work})
            best = min((x for x in work.values() if np.isfinite(x)), default=np.nan)
            own[name] = {scheme: x / best for scheme, x in work.items()}
        for scheme in SCHEMES:
            ratios = np.array([own[name][scheme] for name in results])
            ratios = ratios[np.isfinite(ratios)]
            mean = float(np.exp(np.log(ratios).mean())) if len(ratios) else np.nan
            row = {"error": error, "scheme": scheme, "problems": len(ratios), "mean": mean}
            means.append(row | {"worst": float(ratios.max(initial=-np.inf))})
    return rows, means


def draw(results):
    """Draw a panel for each problem with the schemes that are best somewhere."""
    shown = ("S2", "Y4", "BM4", "BM6", "SS6s13", "SS8s21", "SS10s35")
    figure, axes = plt.subplots(3, 4, figsize=(16, 11))
    for axis, (name, found) in zip(axes.flat, results.items(), strict=False):
        for scheme in shown:
            error, work = settled(found[scheme]).T
            axis.loglog(error, work, ".-", label=scheme)
        axis.set(title=name, xlim=(1e-1, 1e-14), xlabel="error", ylabel="work")
        axis.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=7)
    figure.tight_layout()
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure.savefig(FOLDER / "compositions.png", dpi=120)


def main():
    results = {name: study(name, span) for name, span in PROBLEMS.items()}
    draw(results)
    rows, means = tables(results)
    show(rows)
    print("\nWork beside the best scheme's, geometric mean over the problems:\n")
    show(means)


if __name__ == "__main__":
    main()
