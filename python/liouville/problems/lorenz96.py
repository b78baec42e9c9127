r"""The model of Lorenz of 1996 without forcing and damping, for any number n of sites; no units.

.. math::

    x_i' = (x_{i+1} - x_{i-2})\, x_{i-1}, \qquad i = 0, \dots, n - 1, \text{ modulo } n

Constant is the "energy", :math:`\tfrac12 \sum x_i^2`. The motion is chaotic. No term of
:math:`x_i'` contains :math:`x_i`: with n a multiple of 3 three natural shears make the whole field.

E. N. Lorenz, Predictability: a problem partly solved, in: Seminar on Predictability, ECMWF (1996)
1-18. The references, for 36 sites, are by extrapolation in 45 digits, two tolerances 7e-34 apart
(``tools/field_references.py``); with the start repeated they hold for n = 72, 108, ... too.
"""

from typing import Any

import numpy as np

from liouville._systems import PolynomialField


def build(sites: int) -> PolynomialField:
    """Make the system of a ring.

    Parameters
    ----------
    sites : int
        Number of sites n, at least 4; a million takes seconds.

    Returns
    -------
    PolynomialField
        With coordinates x0, ..., x(n-1).
    """
    if sites < 4:
        raise ValueError(f"a ring has at least 4 sites, not {sites}")
    i = np.arange(sites)
    after, before, second = (i + 1) % sites, (i - 1) % sites, (i - 2) % sites
    component = np.concatenate([i, i])
    variables = np.column_stack([np.concatenate([after, second]), np.concatenate([before, before])])
    terms = component, np.repeat([1.0, -1.0], sites), variables
    return PolynomialField.from_terms(sites, terms, invariants={"energy": np.full(sites, 0.5)})


def start_for(sites: int) -> dict[str, Any]:
    """Start with values between -1 and 3/2, of period 36 along the ring."""
    i = np.arange(sites) % 36
    return {"x": (5 * i % 9) / 4 - 1 + i / 72}


system = build(36)
start: dict[str, Any] = start_for(36)
interval = (0.0, 5.0)
h = 0.05
conserved = ("energy",)
reference = {
    1.0: {
        "x": (
            -0.9000274952502199175784,
            0.1478900146077441985375,
            -0.01493999442191437793734,
            0.7522603665541203405882,
            0.3942955138762551392958,
            0.8672130760739864032168,
            0.6618288440228648342459,
            0.5646884866904192349265,
            -0.9719944302569900825450,
            -0.6913873248710488247685,
            0.2490306452817007120049,
            0.1081301963777273196193,
            0.7938761184966124795202,
            0.5810578240805411442404,
            0.9523252128903765606962,
            0.7521880537825231394520,
            0.4902553378499272534220,
            -0.9273741960117245939079,
            -0.6321335870772387180753,
            0.2914026578665461144017,
            0.3577179838386822789838,
            0.8804757334723072155749,
            0.7283451345597195452608,
            1.052711406786763053089,
            0.8329646790105063065025,
            0.4076226627172095856577,
            -0.8779640831099941645189,
            -0.5757041400817400235605,
            0.3536434752409460721579,
            0.6245690115453570936582,
            0.9960739904364160259245,
            0.8669984537067460529784,
            1.141673663993072470181,
            0.8083366212509951426367,
            0.1408227008213891814807,
            -1.176982479225410374231,
        ),
    },
    5.0: {
        "x": (
            -0.6833957028291246418773,
            0.1297833722815855698630,
            -0.8229430011656587044107,
            0.07294421537997881587677,
            -1.529491589585851790093,
            -0.1129578865549113534597,
            -0.2959676042384699931762,
            0.8510027707819308575212,
            0.5181958557801431216039,
            0.7799325404060425002467,
            -0.2886459572963031353158,
            0.6750215751148186253742,
            -0.4994419239346413716158,
            0.7133307105227692550159,
            0.9410200686038610564824,
            -0.8265593022466175112568,
            0.4435493062495819747377,
            -0.7555246501414354472453,
            0.5642738660473537560261,
            -0.4670700966877419456494,
            0.4638390176814903124591,
            -1.323636713357397651523,
            -0.5363439832550125246714,
            0.8475234046340561372962,
            0.07817107391540968306266,
            -0.9689494271064043765201,
            0.2824549420237383868604,
            -0.1288068005986725804788,
            -0.2603254347850287334258,
            -1.089620095204359256589,
            -1.282649552158676713404,
            -0.5383327909150657262920,
            -0.5284685012600865131828,
            1.226336338192334059453,
            -0.07642631624578152929570,
            -0.5820018039739075850660,
        ),
    },
}
source = "Lorenz (1996); extrapolation in 45-digit arithmetic"
