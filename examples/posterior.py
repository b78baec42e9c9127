"""
A posterior by NUTS
===================

Damping is positive, and twelve angles of a swing say little about it: its values are not spread as
an ellipse around the best one. NumPyro's sampler takes the run and its gradient as a function of
JAX, so that the posterior is that of the same motion that ``lv.fit`` fits.
"""

import casadi as ca
import jax
import matplotlib.pyplot as plt
import numpy as np
import numpyro
from numpyro import distributions as dist

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)
jax.config.update("jax_enable_x64", True)

# %%
# A pendulum in its angle: twelve angles, good to 0.08 rad.

system = lv.Lagrangian(
    lambda t, q, v, params: v[0] ** 2 / 2 + params.w**2 * ca.cos(q[0]),
    q=("angle",),
    force=lambda t, q, v, params: -params.c * v,
    params={"w": 3.0, "c": 0.1},
)
run = {"t": (0.0, 3.0), "steps": 24, "q": [1.0], "v": [0.0]}
rng = np.random.default_rng(5)
sigma = 0.08
truth = lv.integrate(system, lv.Spark(3), **run, every=2)
seen = truth.q[1:, 0] + sigma * rng.standard_normal(12)

# %%
# The fit knows of a minimum and its curvature.

data = {"t": truth.t[1:], "angle": seen}
found = lv.fit(
    system,
    lv.Spark(3),
    data,
    h=0.125,
    t0=0.0,
    params=("w", "c"),
    bounds={"c": (0.0, None)},
    sigma=sigma,
    q=[1.0],
    v=[0.0],
)
found

# %%
# The model says the same with priors: a flat one of the frequency, a half-normal one of the
# damping. ``solve`` is the run, whose gradient is its pullback.

solve = lv.jax.solver(system, lv.Spark(3), wrt=["params.w", "params.c"], every=2, **run)


def model():
    w = numpyro.sample("w", dist.Uniform(2.0, 4.0))
    c = numpyro.sample("c", dist.HalfNormal(0.5))
    numpyro.sample("seen", dist.Normal(solve(w, c)[1:, 0], sigma), obs=seen)


sampler = numpyro.infer.MCMC(
    numpyro.infer.NUTS(model), num_warmup=200, num_samples=500, progress_bar=False
)
sampler.run(jax.random.PRNGKey(0))
drawn = {name: np.asarray(x) for name, x in sampler.get_samples().items()}
for name, x in drawn.items():
    print(f"{name} = {x.mean():.3f} ± {x.std():.3f}")

# %%
# The damping has a tail; the normal of the fit goes below zero.

fig, ax = plt.subplots()
ax.hist(drawn["c"], 20, density=True, label="NUTS")
c = np.linspace(-0.1, 0.3, 200)
error = found.errors["params.c"]
normal = np.exp(-(((c - found.params["c"]) / error) ** 2) / 2) / (
    error * np.sqrt(2 * np.pi)
)
ax.plot(c, normal, label="fit")
ax.set(xlabel="damping in 1/s", ylabel="density")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
