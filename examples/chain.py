"""
The largest stable step of a taut chain
=======================================

A chain of ten links hangs at rest and is perturbed slightly. Its links vibrate sideways, faster
under higher tension, and SPARK with s stages has a largest stable step for such vibrations. Dashed
are the limits of linear theory, which *Choosing* lists. Crosses are runs that ended in an error.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import chain

plt.style.use(plot.STYLE)

LINKS, STEPS = 10, 400
LIMITS = {1: 2.00, 2: 2.83, 3: 3.11, 4: 3.14}

# %%
# The fastest vibration of the hanging chain: masses 1/N on links of length 1/N, where the tension
# in each link is the weight below it.

tension = np.arange(LINKS, 0, -1) / LINKS
difference = np.eye(LINKS) - np.eye(LINKS, k=-1)
stiffness = difference.T @ np.diag(tension * LINKS) @ difference
omega = np.sqrt(np.linalg.eigvalsh(stiffness * LINKS)[-1])

# %%
# A perturbation of a millionth, 400 steps, and the largest displacement of the chain.

system = chain.build(LINKS)
nudge = np.zeros(2 * LINKS)
nudge[::2] = 1e-6 * np.random.default_rng(1).standard_normal(LINKS)
start = system.consistent(q=chain.start_for(LINKS)["q"], v=nudge)
system

# %%
# A run whose step is too large fails, and its error carries the solution so far.


def swing(stages, h):
    """Return the largest sideways displacement, and whether the run was finished."""
    try:
        solution = lv.integrate(
            system, lv.Spark(stages), t=(0, STEPS * h), steps=STEPS, **start
        )
    except lv.IntegrationError as error:
        return np.abs(error.solution.q[:, ::2]).max(), False
    return np.abs(solution.q[:, ::2]).max(), True


# %%
# Steps from well below the limits to well above them.

fig, ax = plt.subplots(figsize=(6.4, 4))
products = np.linspace(1.5, 4.0, 51)
for stages, limit in LIMITS.items():
    sizes, done = np.array([swing(stages, x / omega) for x in products]).T
    (line,) = ax.semilogy(products, sizes, lw=1, label=f"s = {stages}")
    failed = done == 0
    ax.semilogy(products[failed], sizes[failed], "x", ms=4, color=line.get_color())
    ax.axvline(limit, color=line.get_color(), ls="--", lw=0.8)
ax.set(xlabel=r"step times fastest frequency, $h\,\omega$", ylabel="largest displacement")
fig.legend(ncols=4, loc="outside upper left")
plt.show()
