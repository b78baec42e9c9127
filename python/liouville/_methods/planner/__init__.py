"""The planner: how a field is split, or a wave function propagated, and why."""

from liouville._methods.planner.choice import plan as plan
from liouville._methods.planner.fields.choice import plan_field as plan_field
from liouville._methods.planner.fields.plan import FieldPlan as FieldPlan
from liouville._methods.planner.fields.plan import Trial as Trial
from liouville._methods.planner.plan import Plan as Plan
from liouville._methods.planner.waves.choice import plan_run as plan_run
from liouville._methods.planner.waves.choice import plan_wave as plan_wave
from liouville._methods.planner.waves.plan import WavePlan as WavePlan
from liouville._methods.planner.waves.steps import plan_steps as plan_steps
