"""Methods: a name and its numbers. What they do stands in the core."""

from liouville.methods.alpha import HHT as HHT
from liouville.methods.alpha import ArnoldBruls as ArnoldBruls
from liouville.methods.alpha import GeneralizedAlpha as GeneralizedAlpha
from liouville.methods.spark import Spark as Spark

Method = Spark | HHT | GeneralizedAlpha | ArnoldBruls

#: Every method by the name the command line knows it by.
METHODS: dict[str, type[Method]] = {
    "spark": Spark,
    "hht": HHT,
    "generalized-alpha": GeneralizedAlpha,
    "arnold-bruls": ArnoldBruls,
}
