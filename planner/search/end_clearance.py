"""Checks of a scene's start and goal: no contact, path constraints, gravity torques, and a free way to brake where the
robot moves; and the clearance that they allow."""

from __future__ import annotations

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import UnsolvableError


def reachable_clearance(setup: Setup, certifier: Certifier) -> tuple[float, tuple[str, ...]]:
    """The clearance that can be required [m]: the scene's, or less, with a note, where its own ends are closer than
    that.

    Raises UnsolvableError if an end is in collision, or breaks a path constraint.
    """
    scene, query = setup.scene, setup.query
    required, words = scene.planner.clearance, []
    lenient = {obstacle.name for obstacle in scene.obstacles if obstacle.clearance is None}
    for field, q, time_ in ((scene.start.field, query.start, 0.0), (scene.goal.field, query.goal, scene.end_time)):
        close = certifier.too_close(q, required, time_)
        if close and close[0][0].distance <= 0.0:
            place, contacts = close[0][0], certifier.contacts(q, time_)
            if not contacts and place.unknown:
                apart = (place.distance + place.unknown) * 1e3
                raise UnsolvableError(
                    f"{scene.source}: {field}: {place.link} and {place.other} are {apart:.3g} mm apart, and "
                    f"{place.unknown * 1e3:.3g} mm are unknown (obstacles[].uncertainty, robot.tracking, "
                    "robot.calibration)",
                    "end_too_close",
                )
            text = "; ".join(
                f"{c.link} and {c.other} " + (f"overlap by {c.depth * 1e3:.3g} mm" if c.depth else "touch")
                for c in contacts[:3]
            )
            text += setup.robot.doubt((c.link, c.other) for c in contacts)
            raise UnsolvableError(f"{scene.source}: {field}: in collision: {text}", "end_in_contact")
        if departures := certifier.off_path(q):
            broken = "; ".join(each.words for each in departures)
            raise UnsolvableError(f"{scene.source}: {field}: breaks a path constraint: {broken}", "end_off_path")
        if overload := certifier.overload(q):
            raise UnsolvableError(f"{scene.source}: {field}: {overload}", "end_overloaded")
        for place, needed in close:
            if place.other not in lenient:
                raise UnsolvableError(
                    f"{scene.source}: {field}: {place.link} is {place.words} from {place.other}, "
                    f"{needed * 1e3:g} mm are required (obstacles[].clearance, self_collision.clearance)",
                    "end_too_close",
                )
        required, word = certifier.allowed(field, close, required)
        words += [word] if word else []
    return required, tuple(words)


def met_by(certifier: Certifier, motion: Trajectory) -> str:
    """Return the contact of a robot on a motion, in words, or the path constraint that it leaves; nothing if it is
    free."""
    last = len(motion.positions) - 2, 1.0  # where it stands: the first contact found settles it
    found = certifier.certify(motion, required=0.0, check_ends=False, suspect=last)
    if found.status is Status.IN_CONTACT:
        return f"{found.failures[0].link} and {found.failures[0].other} would meet"
    return found.departures[0].words if found.status is Status.OFF_PATH else ""
