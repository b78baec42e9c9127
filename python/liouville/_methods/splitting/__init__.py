"""Divergence-free fields as sums of pieces with explicit volume-preserving maps."""

from liouville._methods.splitting.border import to_core as to_core
from liouville._methods.splitting.choice import split as split
from liouville._methods.splitting.commuting import commuting as commuting
from liouville._methods.splitting.describe import described as described
from liouville._methods.splitting.describe import variables_of as variables_of
from liouville._methods.splitting.exponential import has_pairs as has_pairs
from liouville._methods.splitting.pieces import Affine as Affine
from liouville._methods.splitting.pieces import Exponential as Exponential
from liouville._methods.splitting.pieces import Natural as Natural
from liouville._methods.splitting.pieces import Piece as Piece
from liouville._methods.splitting.pieces import Scaling as Scaling
from liouville._methods.splitting.pieces import Shear as Shear
from liouville._methods.splitting.pieces import Split as Split
from liouville._methods.splitting.pieces import Triangular as Triangular
from liouville._methods.splitting.pieces import Turn as Turn
from liouville._methods.splitting.planes import Plane as Plane
from liouville._methods.splitting.planes import PlaneSplit as PlaneSplit
