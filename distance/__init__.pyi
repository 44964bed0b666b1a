"""Public names of hdplan.distance and their homes."""

from hdplan.distance.baselines.coal import signed_distance as signed_distance, signed_distances as signed_distances
from hdplan.distance.baselines.fcl import fcl_distances as fcl_distances
from hdplan.distance.baselines.ground_truth import Proximity as Proximity
from hdplan.distance.batch.distance import hdsdf_batch as hdsdf_batch
from hdplan.distance.bodies import ConvexBody as ConvexBody
from hdplan.distance.holder import (
    holder_maximum as holder_maximum,
    holder_minimum as holder_minimum,
    shaping as shaping,
)
from hdplan.distance.normals import RUNGS as RUNGS
from hdplan.distance.numpy_reference.hdsdf import (
    hdsdf as hdsdf,
    hdsdf_derivatives as hdsdf_derivatives,
    separating_axis_distance as separating_axis_distance,
    separation as separation,
)
from hdplan.distance.symbolic.compiled_pair import hdsdf_compiled as hdsdf_compiled
from hdplan.distance.symbolic.graph_distance import hdsdf_function as hdsdf_function
from hdplan.distance.unions import BodyUnion as BodyUnion
