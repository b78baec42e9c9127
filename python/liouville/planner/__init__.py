"""The planner: how a field is split, or a wave function propagated, and why."""

from liouville.planner.choice import plan as plan
from liouville.planner.fields.choice import plan_field as plan_field
from liouville.planner.fields.plan import FieldPlan as FieldPlan
from liouville.planner.fields.plan import Trial as Trial
from liouville.planner.plan import Plan as Plan
from liouville.planner.waves.choice import plan_wave as plan_wave
from liouville.planner.waves.plan import WavePlan as WavePlan
from liouville.planner.waves.steps import plan_steps as plan_steps
