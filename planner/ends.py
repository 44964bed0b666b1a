"""What the ends of a scene allow: free of contact, on the path, not too heavy; and what clearance can be asked for."""

from __future__ import annotations

from hdplan.planner.certificate import Certifier
from hdplan.planner.robot import Robot
from hdplan.planner.scene_robot import resolve_query
from hdplan.scenes.errors import InputError
from hdplan.scenes.model import Scene

ENDS_KEEP = 0.5  # share of an end's distance that is asked for where it is below planner.clearance


def reachable_clearance(scene: Scene, robot: Robot, certifier: Certifier) -> tuple[float, tuple[str, ...]]:
    """The clearance that can be asked for [m]: the scene's, or less, with a word, where its own ends are closer than
    that.

    Raises InputError if an end is in collision, or breaks a path constraint.
    """
    required, words = scene.planner.clearance, []
    lenient = {obstacle.name for obstacle in scene.obstacles if obstacle.clearance is None}
    query = resolve_query(robot, scene)
    for field, q, time_ in ((scene.start.field, query.start, 0.0), (scene.goal.field, query.goal, scene.end_time)):
        contacts = certifier.contacts(q, time_)
        if contacts:
            said = "; ".join(
                f"{c.link} and {c.other} " + (f"overlap by {c.depth * 1e3:.3g} mm" if c.depth else "touch")
                for c in contacts[:3]
            )
            raise InputError(f"{scene.source}: {field}: in collision: {said}")
        if departures := certifier.off_path(q):
            raise InputError(f"{scene.source}: {field}: off the path: {'; '.join(each.words for each in departures)}")
        if overload := certifier.overload(q):
            raise InputError(f"{scene.source}: {field}: {overload.words}")
        close = certifier.too_close(q, required, time_)
        for place, asked in close:
            if place.other not in lenient:
                raise InputError(
                    f"{scene.source}: {field}: {place.link} is {place.distance * 1e3:.3g} mm from {place.other}, "
                    f"{asked * 1e3:g} mm are asked for (obstacles[].clearance, self_collision.clearance)"
                )
        if close:
            place, _ = close[0]
            required = ENDS_KEEP * place.distance
            words.append(
                f"{field} is {place.distance * 1e3:.3g} mm from {place.other}: "
                f"{required * 1e3:.3g} mm are proven for the whole motion instead of planner.clearance"
            )
    return required, tuple(words)
