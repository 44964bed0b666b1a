"""The pairs of bodies that the planner compares in a scene, with obstacles at their poses in the scene or anywhere.

A movable obstacle is one more frame after the joints', as a moving one is for the planner, and is compared with every
link that moves: wherever it may be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdplan.planner.collision.broad_phase import BodyPairs, body_pairs
from hdplan.planner.collision.collision_model import SELF_ACTIVATION, CollisionModel, collision_model_of
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_obstacle
from hdplan.planner.collision.scene_pairs import (
    all_pairs,
    carried_pieces,
    pairs_of_links,
    pairs_within_reach,
    with_frames,
)
from hdplan.planner.problem.assemble import self_margin
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.values import Row, checked, text


@dataclass(frozen=True, eq=False)
class ScenePairs:
    """P pairs of bodies, in groups: links with obstacles, then links with links."""

    setup: Setup
    model: CollisionModel
    movable: tuple[Obstacle, ...]  # m, whose frames come after the joints'
    groups: tuple[BodyPairs, ...]
    names: tuple[tuple[str, str], ...]  # (P,) link and obstacle, or link and link

    @property
    def poses(self) -> Array:
        """Placements of the movable obstacles in the scene, at its beginning (m, 4, 4)."""
        return np.array([obstacle.pose.matrix for obstacle in self.movable]).reshape(-1, 4, 4)


def scene_pairs(setup: Setup, movable: Sequence[str], activated: bool) -> ScenePairs:
    """Assemble the pairs of a scene: those of the planner, and of every `movable` obstacle, by name.

    Obstacles that move in the scene are movable anyway. Bodies are enlarged by the scene's clearances and, if
    `activated`, by how much earlier the planner's penalty begins. Raises InputError for an unknown obstacle, and for
    planner.distance fcl, which is no expression.
    """
    scene, settings = setup.scene, setup.scene.planner
    setup.refuse_sizes("distances in symbols know only the nominal scene")
    if settings.distance != "hdsdf":
        raise InputError(
            f"{scene.source}: planner.distance: must be hdsdf to be an expression, found {settings.distance}"
        )
    moved = _movable(setup, movable)
    model, extra = (
        collision_model_of(setup.robot, settings.link_bodies, settings.normals),
        settings.activation * activated,
    )
    kinematics, bodies = model.kinematics, model.bodies
    pieces: list[HalfspaceBody] = []
    with naming(scene.source):
        for obstacle in scene.obstacles:
            if obstacle not in moved:
                pieces += from_obstacle(obstacle, settings.normals)[0]
        standing = len(pieces)
        for row, obstacle in enumerate(moved):
            pieces += carried_pieces(obstacle, kinematics.nj + row, settings.normals)[0]
    clearances = scene.clearances
    margins = np.array([clearances[piece.name] + extra for piece in pieces])
    reached = pairs_within_reach(model, pieces[:standing], margins[:standing])
    met = np.concatenate([reached, all_pairs(bodies, range(standing, len(pieces)))])
    supports = with_frames(kinematics.supports, len(moved))
    margin = self_margin(setup)
    within, _ = pairs_of_links(model, margin)
    groups, names = [], []
    if len(met):
        groups.append(body_pairs(bodies, pieces, met, margins, supports))
        names += [(bodies[a].link, pieces[b].name) for a, b in met.tolist()]
    if within:
        grown = margin - SELF_ACTIVATION * (not activated)
        groups.append(body_pairs(bodies, model.planes, within, grown, supports))
        names += [(bodies[a].link, bodies[b].link) for a, b in within]
    return ScenePairs(setup, model, moved, tuple(groups), tuple(names))


def all_movable(setup: Setup) -> ScenePairs:
    """Assemble the pairs of a scene in which every obstacle is movable, not activated."""
    return scene_pairs(setup, [each.name for each in setup.scene.obstacles], activated=False)


def _movable(setup: Setup, names: Sequence[str] | None) -> tuple[Obstacle, ...]:
    """Return the obstacles that move in the scene, or are named."""
    obstacles = setup.scene.obstacles
    known = [each.name for each in obstacles]
    wanted = checked(Row(text, of="names of obstacles"), names, "movable")
    for name in wanted:
        if name not in known:
            raise InputError(f"movable: {setup.scene.name} has no obstacle '{name}'{nearest(name, known)}")
    return tuple(each for each in obstacles if each.motion is not None or each.name in wanted)
