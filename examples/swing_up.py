"""
Swinging up a linkage on a cart
===============================

Two rods hang from a cart, and a third one joins their ends: a closed loop. The motor of the cart
swings it up, from rest below to rest above in 2 s, with the least effort. The loop is closed by
constraints, and nothing is reduced by hand.
"""

# %%
# The ends of the rods are points of half a kilogram. The hinges in the cart are nearer to each
# other than all other sides, so that the loop turns all the way round.

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)


def lagrangian(t, q, v, params):
    return v[0] ** 2 / 2 + ca.dot(v[1:], v[1:]) / 4 - 9.81 * (q[2] + q[4]) / 2


def rods(t, q, params):
    left, right = q[0] - 0.1, q[0] + 0.1
    return {
        "left": ((q[1] - left) ** 2 + q[2] ** 2 - 0.57**2) / 2,
        "right": ((q[3] - right) ** 2 + q[4] ** 2 - 0.62**2) / 2,
        "loop": ((q[1] - q[3]) ** 2 + (q[2] - q[4]) ** 2 - 0.5**2) / 2,
    }


linkage = lv.Lagrangian(
    lagrangian,
    rods,
    force=lambda t, q, v, params: [params.push, 0, 0, 0, 0],
    q=("cart", "x1", "y1", "x2", "y2"),
    params={"push": 0.0},
)

# %%
# Start and end are equilibria: the stable one, and the one from which it would fall. Both are with
# the cart at zero.


def rest(stable, **near):
    found = lv.analysis.equilibrium(
        linkage, stable=stable, **linkage.consistent(v=np.zeros(5), **near)
    ).start
    shift = found["q"][0] * np.array([1, 1, 0, 1, 0])
    return {"q": found["q"] - shift, "v": np.zeros(5)}


below = rest(True, q=[0, -0.25, -0.55, 0.25, -0.6])
above = rest(False, q=[0, 0.25, 0.55, -0.25, 0.6])

# %%
# The parameter ``push`` becomes a control. The equations of 40 steps are constraints of a sparse
# nonlinear program; the final state is given whole, as it satisfies the constraints.

found = lv.optimal_control(
    linkage,
    lv.Spark(3),
    controls=("push",),
    cost=lambda t, q, v, params: params.push**2 / 2,
    t=(0, 2),
    steps=40,
    final=above,
    **below,
)
found

# %%
# The force at nodes comes from the costates and has the order of the method, 6; the dots are the
# forces at the stages, which drive the motion.

fig, ax = plt.subplots()
ax.plot(found.t, found.controls["push"])
ax.plot(found.stage_t.ravel(), found.stage_controls["push"].ravel(), ".", ms=3)
ax.set(xlabel="time / s", ylabel="force / N", title="force on the cart")
plt.show()

# %%
# The motion in pictures, a tenth of a second apart, each moved to the right.

fig, ax = plt.subplots(figsize=(7, 2.6))
for k in range(0, 41, 2):
    cart, x1, y1, x2, y2 = found.q[k] + 0.35 * k * np.array([1, 1, 0, 1, 0])
    ax.plot(
        [cart - 0.1, x1, x2, cart + 0.1], [0, y1, y2, 0], color=plt.cm.viridis(k / 44)
    )
    ax.plot([cart - 0.1, cart + 0.1], [0, 0], color="0.2", lw=3)
ax.set(aspect="equal", xticks=[], ylabel="y / m")
plt.show()

# %%
# A run of the same method by these forces repeats the motion, with its constraints at roundoff: the
# optimum does not depend on the optimiser. What the rods bear comes out with it.

solution = found.solution
print(np.abs(solution.q - found.q).max(), np.abs(solution.residuals["constraint"]).max())

fig, ax = plt.subplots()
ax.plot(found.t, found.lam * [0.57, 0.62, 0.5])
ax.set(xlabel="time / s", ylabel="tension / N", title="forces in the rods")
fig.legend(linkage.constraints, ncols=3, loc="outside upper right")
plt.show()
