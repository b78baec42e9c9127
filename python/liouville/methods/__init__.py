"""Methods: a name and its numbers. What they do stands in the core."""

from liouville.methods.alpha import HHT as HHT
from liouville.methods.alpha import ArnoldBruls as ArnoldBruls
from liouville.methods.alpha import GeneralizedAlpha as GeneralizedAlpha
from liouville.methods.composition import Composition as Composition
from liouville.methods.spark import Spark as Spark
from liouville.methods.volume import VolumeSplitting as VolumeSplitting

Method = Spark | HHT | GeneralizedAlpha | ArnoldBruls | Composition | VolumeSplitting

#: Every method by the name the command line knows it by.
METHODS: dict[str, type[Spark | HHT | GeneralizedAlpha | ArnoldBruls | VolumeSplitting]] = {
    "spark": Spark,
    "hht": HHT,
    "generalized-alpha": GeneralizedAlpha,
    "arnold-bruls": ArnoldBruls,
    "volume-splitting": VolumeSplitting,
}
