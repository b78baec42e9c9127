"""
The length of a pendulum, from noisy data
=========================================

A camera sees the bob of a pendulum thirty times in three seconds, to a centimetre. How long is the
rod, how strong is gravity, and how sure is that? A least-squares fit wants the residuals and their
derivatives; both come from one run with tangents.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import least_squares

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

pendulum = lv.Lagrangian(
    lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1],
    lambda t, q, params: {"rod": ca.dot(q, q) - params.l**2},
    q=("x", "y"),
    params={"g": 9.81, "l": 1.0},
)

# %%
# A run begins at rest on the rod, at an angle that is unknown too. Its first point moves with the
# length: `consistent` puts it there, and so it does in the derivatives.

NAMES = ("params.l", "params.g", "q")


def run(x):
    length, gravity, angle = x
    params = {"l": length, "g": gravity}
    q = length * np.array([np.sin(angle), -np.cos(angle)])
    turn = length * np.array([np.cos(angle), np.sin(angle)])  # of q, by the angle
    return lv.integrate(
        pendulum, lv.Spark(3), t=(0, 3), steps=150, every=5, params=params,
        tangents=dict(zip(NAMES, (1.0, 1.0, turn), strict=True)), q=q, v=np.zeros(2),
    )  # fmt: skip


def jacobian(x):
    tangents = run(x).tangents
    return np.stack([tangents[name].q.ravel() for name in NAMES], axis=1)


truth, noise = np.array([1.2, 9.7, 0.8]), 0.01
seen = run(truth).q
seen = seen + noise * np.random.default_rng(0).standard_normal(seen.shape)

# %%
# The fit starts from a rod that is a fifth too short. Its covariance is that of the linearised
# residuals at the end.

fit = least_squares(lambda x: (run(x).q - seen).ravel(), [1.0, 9.0, 0.5], jac=jacobian)
deviations = noise * np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
for name, found, deviation, true in zip(
    ("length / m", "gravity / (m/s²)", "angle"), fit.x, deviations, truth, strict=True
):
    print(f"{name:17} {found:.4f} ± {deviation:.4f}   (was {true})")
print(f"{fit.nfev} runs")

# %%
# The period knows the ratio of length and gravity alone, and the places of the bob the length.

solution = run(fit.x)
fig, (left, right) = plt.subplots(1, 2)
left.plot(solution.t, solution.q, label=["x", "y"])
left.plot(solution.t, seen, ".", color="k", ms=3)
left.set(xlabel="time / s", ylabel="place of the bob / m")
right.plot(solution.t, solution.tangents["params.l"].q[:, 0], label="by the length")
right.plot(solution.t, solution.tangents["params.g"].q[:, 0], label="by gravity")
right.set(xlabel="time / s", ylabel="derivative of x")
fig.legend(ncols=4, loc="outside upper left")
plt.show()
