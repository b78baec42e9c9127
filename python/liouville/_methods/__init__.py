"""Methods: a name and its numbers. The core carries them out."""

from liouville._methods.alpha import HHT as HHT
from liouville._methods.alpha import ArnoldBruls as ArnoldBruls
from liouville._methods.alpha import GeneralizedAlpha as GeneralizedAlpha
from liouville._methods.composition import Composition as Composition
from liouville._methods.lobatto import LobattoPair as LobattoPair
from liouville._methods.schrodinger import Chebyshev as Chebyshev
from liouville._methods.schrodinger import Lanczos as Lanczos
from liouville._methods.schrodinger import Magnus as Magnus
from liouville._methods.schrodinger import SchrodingerSplitting as SchrodingerSplitting
from liouville._methods.schrodinger import SplitOperator as SplitOperator
from liouville._methods.shears import GrayManolopoulos as GrayManolopoulos
from liouville._methods.shears import StabilitySplitting as StabilitySplitting
from liouville._methods.shears import shears_of as shears_of
from liouville._methods.spark import Spark as Spark
from liouville._methods.volume import VolumeSplitting as VolumeSplitting

#: The methods of wave functions.
WaveMethod = (
    SchrodingerSplitting
    | Chebyshev
    | Lanczos
    | SplitOperator
    | Magnus
    | StabilitySplitting
    | GrayManolopoulos
)

#: Those with steps of a given size.
Stepped = SplitOperator | Magnus | StabilitySplitting | GrayManolopoulos

Method = (
    Spark
    | LobattoPair
    | HHT
    | GeneralizedAlpha
    | ArnoldBruls
    | Composition
    | VolumeSplitting
    | WaveMethod
)

#: Every method by its name on the command line.
METHODS: dict[str, type[Method]] = {
    "spark": Spark,
    "lobatto-pair": LobattoPair,
    "hht": HHT,
    "generalized-alpha": GeneralizedAlpha,
    "arnold-bruls": ArnoldBruls,
    "volume-splitting": VolumeSplitting,
    "schrodinger-splitting": SchrodingerSplitting,
    "chebyshev": Chebyshev,
    "lanczos": Lanczos,
    "split-operator": SplitOperator,
    "magnus": Magnus,
    "stability-splitting": StabilitySplitting,
    "gray-manolopoulos": GrayManolopoulos,
}
