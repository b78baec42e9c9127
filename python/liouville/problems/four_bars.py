r"""N four-bars side by side, which pass a singular position together, in kg, m, s.

N + 1 rods of 1 m and 1 kg stand on the ground, 1 m apart, and N like rods join their tips. They are
parallelograms: all standing rods have the angle a, and the others are level. Where a = 0 all lie on
one line, where each loop could go on as an antiparallelogram, and the constraints lose rank. With

.. math::

    I = \tfrac13 (N + 1) + N, \quad w = \tfrac12 (N + 1) + N, \quad
    \ddot a = -\frac w I g \cos a

they move as one pendulum. They start upright with the tips at 1 m/s and swing through.

A benchmark of multibody codes: M. González, D. Dopico, U. Lugrís, J. Cuadrado, Multibody Syst. Dyn.
16 (2006) 179-190. The reference is the angle for N = 3, extrapolated in 32 digits
(``tools/mechanism_references.py``).
"""

from typing import Any

import numpy as np

from liouville.bodies import Assembly, Mechanism

UPRIGHT = float(np.pi / 2)


def build(loops: int) -> Mechanism:
    """Make the system of so many four-bars, at least 1.

    Bodies are rod1 to the last standing one, then bar1 to the last level one, each with x, y and
    its angle.
    """
    m = Assembly(gravity=lambda params: (0.0, -params.g, 0.0))
    z = (0.0, 0.0, 1.0)
    for k in range(loops + 1):
        m.planar_body(f"rod{k + 1}", mass=1.0, inertia=1 / 12, at=(k, 0.5), angle=UPRIGHT)
    for k in range(loops):
        m.planar_body(f"bar{k + 1}", mass=1.0, inertia=1 / 12, at=(k + 0.5, 1.0))
    for k in range(loops + 1):
        m.revolute(f"foot{k + 1}", "ground", f"rod{k + 1}", at=(k, 0.0, 0.0), axis=z)
    for k in range(loops):
        m.revolute(f"left{k + 1}", f"rod{k + 1}", f"bar{k + 1}", at=(k, 1.0, 0.0), axis=z)
        m.revolute(f"right{k + 1}", f"rod{k + 2}", f"bar{k + 1}", at=(k + 1, 1.0, 0.0), axis=z)
    return m.system(params={"g": 9.81})


def start_for(loops: int, speed: float = 1.0) -> dict[str, Any]:
    """Return the start upright, with the tips at a speed along x."""
    q = [row for k in range(loops + 1) for row in (k, 0.5, UPRIGHT)]
    q += [row for k in range(loops) for row in (k + 0.5, 1.0, 0.0)]
    v = [speed / 2, 0.0, -speed] * (loops + 1) + [speed, 0.0, 0.0] * loops
    return {"q": np.array(q), "v": np.array(v)}


system = build(3)
start: dict[str, Any] = start_for(3)
interval = (0.0, 2.0)
h = 0.02
conserved = ("energy",)
reference = {
    1.0: {
        "q": (
            -0.0846438922994351360569,
            -0.492783331187654545726,
            -1.74090330541684040331,
            0.915356107700564863943,
            -0.492783331187654545726,
            -1.74090330541684040331,
            1.91535610770056486394,
            -0.492783331187654545726,
            -1.74090330541684040331,
            2.91535610770056486394,
            -0.492783331187654545726,
            -1.74090330541684040331,
            0.330712215401129727886,
            -0.985566662375309091452,
            0.0,
            1.33071221540112972789,
            -0.985566662375309091452,
            0.0,
            2.33071221540112972789,
            -0.985566662375309091452,
            0.0,
        ),
        "v": (
            -3.34040858840157993484,
            0.573771811865731708529,
            -6.77865580467358454374,
            -3.34040858840157993484,
            0.573771811865731708529,
            -6.77865580467358454374,
            -3.34040858840157993484,
            0.573771811865731708529,
            -6.77865580467358454374,
            -3.34040858840157993484,
            0.573771811865731708529,
            -6.77865580467358454374,
            -6.68081717680315986967,
            1.14754362373146341706,
            0.0,
            -6.68081717680315986967,
            1.14754362373146341706,
            0.0,
            -6.68081717680315986967,
            1.14754362373146341706,
            0.0,
        ),
    },
    2.0: {
        "q": (
            0.0251432525071922456113,
            0.499367416691717653417,
            -4.76269670307282225726,
            1.02514325250719224561,
            0.499367416691717653417,
            -4.76269670307282225726,
            2.02514325250719224561,
            0.499367416691717653417,
            -4.76269670307282225726,
            3.02514325250719224561,
            0.499367416691717653417,
            -4.76269670307282225726,
            0.550286505014384491223,
            0.998734833383435306833,
            0.0,
            1.55028650501438449122,
            0.998734833383435306833,
            0.0,
            2.55028650501438449122,
            0.998734833383435306833,
            0.0,
        ),
        "v": (
            0.506468228691486077339,
            -0.0255007798570924045529,
            -1.01421961418069869775,
            0.506468228691486077339,
            -0.0255007798570924045529,
            -1.01421961418069869775,
            0.506468228691486077339,
            -0.0255007798570924045529,
            -1.01421961418069869775,
            0.506468228691486077339,
            -0.0255007798570924045529,
            -1.01421961418069869775,
            1.01293645738297215468,
            -0.0510015597141848091057,
            0.0,
            1.01293645738297215468,
            -0.0510015597141848091057,
            0.0,
            1.01293645738297215468,
            -0.0510015597141848091057,
            0.0,
        ),
    },
}
source = "González et al. (2006); its angle extrapolated in 32-digit arithmetic"
