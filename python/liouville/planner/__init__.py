"""The planner: which pieces, in which order, and why."""

from liouville.planner.choice import plan as plan
from liouville.planner.choice import planned as planned
from liouville.planner.plan import Plan as Plan
from liouville.planner.plan import Trial as Trial
