"""Public names of hdplan.symbolic and their homes."""

from hdplan.distance.symbolic.graph_distance import hdsdf_function
from hdplan.planner.symbolic.clearance import SceneClearance as SceneClearance, clearance as clearance
from hdplan.planner.symbolic.dynamics import dynamics as dynamics
from hdplan.planner.symbolic.kinematics import kinematics as kinematics
from hdplan.planner.traced.cost import JaxCost as JaxCost, jax_cost as jax_cost

distance = hdsdf_function
