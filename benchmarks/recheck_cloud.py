"""Re-check a trajectory in a cloud of points by brute force: every ball against every link at dense samples.

Shares nothing with hdplan: URDF, kinematics, meshes and FCL as in `recheck`, hulls by SciPy. It can refute a
certificate, not give one.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import fcl
import numpy as np
from recheck import Moved
from scipy.spatial import ConvexHull, cKDTree

from hdplan.scenes.array_types import Array


def touching(trajectory: Path, request: Path, robot: Path, points: Array, radius: float) -> dict[str, Any] | None:
    """Return the first contact found, of a link with the ball of a point (m, 3) in the world, or None."""
    motion = Moved.of(json.loads(trajectory.read_text()), request, robot)
    nearby, ball = cKDTree(points), fcl.Sphere(radius)
    for link in motion.links:
        placements = motion.frames[link.name] @ link.pose
        if np.ptp(placements, axis=0).max() < 1e-12:
            continue  # fixed to the world: it may stand on what is seen
        reach = link.radius + radius
        planes = None if link.mesh is None else ConvexHull(link.mesh.vertices).equations
        for t, pose in enumerate(placements):
            rows = nearby.query_ball_point(pose[:3] @ np.append(link.center, 1.0), reach)
            local = (points[rows] - pose[:3, 3]) @ pose[:3, :3]
            if planes is not None and len(local):  # the others are outside of the hull, by more than the radius
                local = local[(local @ planes[:, :3].T + planes[:, 3]).max(axis=1) <= radius]
            for point in local:
                bodies = fcl.CollisionObject(link.shape), fcl.CollisionObject(ball, fcl.Transform(point))
                hit = fcl.collide(*bodies, fcl.CollisionRequest(), fcl.CollisionResult())
                if hit or (link.mesh is not None and link.mesh.is_watertight and link.mesh.contains(point[None])[0]):
                    return {"link": link.name, "time": float(motion.times[t]), "point": point.tolist()}
    return None
