"""Optimal control: the controls that drive a mechanical system at the least cost."""

from liouville._studies.optimal.control import optimal_control as optimal_control
from liouville._studies.optimal.result import OptimalControl as OptimalControl
