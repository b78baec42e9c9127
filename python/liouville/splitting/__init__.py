"""Divergence-free fields as sums of pieces with explicit volume-preserving maps."""

from liouville.splitting.border import to_core as to_core
from liouville.splitting.choice import split as split
from liouville.splitting.commuting import commuting as commuting
from liouville.splitting.describe import described as described
from liouville.splitting.describe import variables_of as variables_of
from liouville.splitting.exponential import has_pairs as has_pairs
from liouville.splitting.pieces import Affine as Affine
from liouville.splitting.pieces import Exponential as Exponential
from liouville.splitting.pieces import Natural as Natural
from liouville.splitting.pieces import Piece as Piece
from liouville.splitting.pieces import Scaling as Scaling
from liouville.splitting.pieces import Shear as Shear
from liouville.splitting.pieces import Split as Split
from liouville.splitting.pieces import Triangular as Triangular
from liouville.splitting.pieces import Turn as Turn
from liouville.splitting.planes import Plane as Plane
from liouville.splitting.planes import PlaneSplit as PlaneSplit
