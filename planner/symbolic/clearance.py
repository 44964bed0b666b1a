"""The distances of a scene's pairs of bodies as one CasADi Function of the configuration and of obstacles' poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from hdplan.distance.symbolic.graph_halfspaces import halfspace_function
from hdplan.distance.symbolic.graph_poses import rigid_or_nan
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.robot.setup import Setup
from hdplan.planner.symbolic.kinematics import joint_values
from hdplan.planner.symbolic.pairs import ScenePairs, scene_pairs
from hdplan.scenes.array_types import Array
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import instance


@dataclass(frozen=True, eq=False, repr=False)
class SceneClearance:
    """The distances of P pairs of bodies; made by `clearance`.

    Attributes:
        function: CasADi Function ``(q (n,), poses (4, 4 m)) -> distance (P,)``: planned joints [rad or m], the movable
            obstacles' poses in the world side by side, and D of every pair [m].
        pairs: link and obstacle, or link and link, of each of the P; an obstacle of several pieces has several pairs.
        movable: names of the m obstacles whose poses are inputs.
        poses: their poses in the scene at time 0 (4, 4 m).
        unresolved: pairs of links that are in none of the P, as their outer bodies overlap nearly everywhere: only the
            certificate compares them.
    """

    function: ca.Function
    pairs: tuple[tuple[str, str], ...]
    movable: tuple[str, ...]
    poses: Array
    unresolved: tuple[tuple[str, str], ...]

    def __repr__(self) -> str:
        """Return the number of pairs and the movable obstacles, for display."""
        return f"<SceneClearance: {len(self.pairs)} pairs, movable: {', '.join(self.movable) or 'none'}>"


def clearance(scene: Scene, movable: Sequence[str] = (), activated: bool = False) -> SceneClearance:
    """Return the planner's distance D of every pair of bodies of a scene that can meet, as expressions.

    D > 0 proves that the bodies are farther apart than the scene's clearance; it is 0 where they are that close, and
    there its derivatives vanish. A hard constraint therefore needs D ≥ the shaping length (1 mm) or more, where they do
    not vanish. D is a lower bound in sign and an approximation in value (`hdplan.distance`). First and second
    derivatives are closed forms, right at every pose, aligned and touching ones too; a third is refused. D is NaN for
    poses of obstacles that are not rigid.

    Args:
        scene: robot, held objects, obstacles and planner settings.
        movable: names of obstacles whose poses are inputs; those that move in the scene always are. Pairs with others
            are left out where the link cannot reach the obstacle within the joint limits, which joints must keep.
        activated: enlarge the bodies by how much earlier the planner's penalty sets in too (``planner.activation``):
            the penalty of a configuration is then Σ ½ min(D, 0)².

    Raises:
        InputError: for an unknown obstacle, for ``planner.distance: fcl``, and for every other reason to refuse the
            scene.
    """
    instance(scene, Scene, "scene")
    instance(activated, bool, "activated")
    found = scene_pairs(Setup.of(scene), movable, activated)
    return SceneClearance(
        clearance_function(found),
        found.names,
        tuple(obstacle.name for obstacle in found.movable),
        np.hstack([np.empty((4, 0)), *found.poses]),
        found.model.unresolved,
    )


def clearance_function(found: ScenePairs) -> ca.Function:
    """Return D (P,) of pairs of bodies as a Function of q (n,) and the movable obstacles' poses (4, 4 m)."""
    robot, tree, settings = found.setup.robot, found.model.kinematics, found.setup.scene.planner
    q, poses = ca.MX.sym("q", robot.n), ca.MX.sym("poses", 4, 4 * len(found.movable))
    state = tree.state(joint_values(robot, q))
    obstacles = ca.horzsplit(poses, 4) if found.movable else []
    own = [ca.vertcat(ca.vec(pose[:3, :3].T), pose[:3, 3]) for pose in obstacles]
    frames = ca.horzcat(ca.reshape(state[: 12 * tree.nj], 12, tree.nj), *own)
    parts = [_distances(pairs, frames, settings.gamma, settings.shaping_length) for pairs in found.groups]
    distance = ca.vertcat(ca.MX(0, 1), *parts)
    if obstacles:
        distance += rigid_or_nan(*obstacles)
    return ca.Function("clearance", [q, poses], [distance], ["q", "poses"], ["distance"])


def _distances(pairs: BodyPairs, frames: ca.MX, gamma: int, shaping_length: float) -> ca.MX:
    """Return D (P,) of pairs whose joints have frames [R row by row | t] (12, ·) in the world."""
    rows, results = [], []
    for slots, table in pairs.plane_tables.items():
        chosen = np.flatnonzero(pairs.plane_slots == slots)
        joints = (frames[:, carrier[chosen].tolist()] for carrier in (pairs.joint_a, pairs.joint_b))
        bodies, planes = ca.DM(pairs.body_table[pairs.body[chosen]].T), ca.DM(table[pairs.plane_row[chosen]].T)
        function = halfspace_function(pairs.vertex_slots, slots, gamma, shaping_length).map(len(chosen))
        results.append(function(*joints, bodies, planes).T)
        rows += chosen.tolist()
    return ca.vertcat(*results)[np.argsort(rows).tolist()]
