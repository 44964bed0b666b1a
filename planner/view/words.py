"""The panel's words as HTML: verdicts, contacts and clearances."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from hdplan.planner.certificate.end_check import SAME_END
from hdplan.planner.certificate.verdict import Certificate, Contact, Status, proven_length
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.drawing.motion import ShownMotion, millimetres, shortened
from hdplan.planner.view.edited_scene import Edited
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.result import PlanResult

OUTDATED = "the scene has changed: this motion is not checked in it yet"


def small(text: str) -> str:
    """Return HTML in the panel's small print; nothing for no text."""
    return f'<div style="padding:0 0.9em;font-size:max(0.8em,11px)">{text}</div>' if text else ""


def next_words(words: str, bad: bool = False) -> str:
    """Return what to do or know now as HTML, in the two lines that are reserved for it."""
    text = html.escape(words)
    return f'<div class="hd hd-two{" hd-bad" if bad else ""}" title="{text}">{text}</div>'


def error_words(error: BaseException) -> str:
    """Return an error in words; of one that is not hdplan's, its kind, too."""
    return str(error) if isinstance(error, HdplanError) else f"{type(error).__name__}: {error}"


def failure_words(scene: Scene, error: BaseException) -> str:
    """Say why there is no plan in a scene, which needs not be named."""
    return error_words(error).removeprefix(f"{scene.source}: ")


def contact_words(contacts: Sequence[Contact]) -> str:
    """Say which bodies touch, the deepest first, three at most."""
    return "; ".join(
        f"{c.link} and {c.other} " + (f"overlap by {c.depth * 1e3:.3g} mm" if c.depth else "touch")
        for c in contacts[:3]
    )


def clearance_words(moment: str, pairs: Sequence[Any]) -> str:
    """Say in two lines how close the robot is to obstacles and to itself; `moment` is when."""
    lines = [_pair(what, pair) for what, pair in zip(("closest", "own links"), pairs, strict=True)]
    return f'<div class="hd" data-moment="{html.escape(moment)}">{"".join(lines)}</div>'


def _pair(what: str, pair: Any) -> str:
    if pair is None:
        return f'<div class="hd-line">{what}: none</div>'
    text = f"<b>{millimetres(pair.distance)}</b> {html.escape(pair.link)} – {html.escape(pair.other)}"
    full = html.escape(f"{what} at the moment that is shown, exact: {pair.link} and {pair.other}")
    return f'<div class="hd-line" title="{full}">{what}: {text}</div>'


def tip_words(place: pin.SE3) -> str:
    """Say where the tip is, in the world: position, roll, pitch and yaw, quaternion."""
    x, y, z = place.translation
    roll, pitch, yaw = np.degrees(pin.rpy.matrixToRpy(place.rotation))
    quaternion = " ".join(f"{each:+.3f}" for each in pin.Quaternion(place.rotation).coeffs())
    return (
        f'<div class="hd">tip [m]: {x:+.3f} {y:+.3f} {z:+.3f}<br/>'
        f"roll, pitch, yaw [°]: {roll:+.1f} {pitch:+.1f} {yaw:+.1f}<br/>x y z w: {quaternion}</div>"
    )


SHORT = {  # of a verdict, on a motion's line
    Status.CERTIFIED: "certified",
    Status.WRONG_ENDS: "wrong ends",
    Status.OUTSIDE_LIMITS: "beyond joint limits",
    Status.IN_CONTACT: "in contact",
    Status.TOO_CLOSE: "too close",
    Status.OFF_PATH: "off the required path",
    Status.TOO_FAST: "too fast",
    Status.OVERLOADED: "overloaded",
    Status.NOT_PROVEN: "not proven",
}


def figures(certificate: Certificate, trajectory: Trajectory) -> str:
    """Return a verdict, the clearance and the duration in one line: what is proven, or the worst place found."""
    parts = [SHORT[certificate.status]]
    if certificate.certified:
        parts += [] if certificate.clearance is None else [proven_length(certificate.clearance)]
    elif found := [place.distance for place in (certificate.worst, certificate.self_worst) if place]:
        parts.append(millimetres(min(found)))
    parts.append("path" if trajectory.duration is None else f"{trajectory.duration:.2f} s")
    return " · ".join(parts)


def whats_next(
    edited: Edited, active: ShownMotion | None, result: PlanResult | None = None, stopped: bool = False
) -> str:
    """Say what to do next in a scene with this active motion, or what keeps it from being done; what is proven
    where all is well. `result` is the plan from which the motion comes, and whether it was `stopped`."""
    for name, contacts in zip(("start", "goal"), edited.contacts, strict=True):
        if contacts:
            return f"{name} is in collision: {contact_words(contacts)}. Drag it, or what it touches, away."
    if edited.missed:
        return f"the goal is out of reach here: {edited.missed}. Drag it nearer."
    if active is None:
        return "no motion yet: press Plan"
    if active.scene is not edited.scene:
        return OUTDATED
    certificate = active.certificate
    if certificate.certified:
        return certificate.text
    if certificate.status is Status.WRONG_ENDS:
        at_start = np.abs(active.joints[0] - edited.start).max() <= SAME_END
        return f"planned for another {'goal' if at_start else 'start'}: press Plan"
    found = SHORT[certificate.status]
    if stopped:
        return f"stopped: the best motion so far is {found}"
    if result is not None and not result.certified and result.requested is edited.scene:
        return f"no free motion found yet, the best one is {found}: press Plan again, or give it more room"
    if certificate.failures:
        worst = min(certificate.failures, key=lambda place: place.distance)
        return f"{found} in this scene: {worst.link} and {worst.other}, {millimetres(worst.distance)}: press Plan"
    return f"{found} in this scene: press Plan"


def badge(edited: Edited, active: ShownMotion | None, holds: bool) -> str:
    """Return the verdict in a few words, as HTML that stands in the scene; nothing without a motion."""
    for name, contacts in zip(("start", "goal"), edited.contacts, strict=True):
        if contacts:
            return badge_of("bad", f"✕ {name} in collision")
    if active is None:
        return ""
    if not holds:
        return badge_of("", "… not checked in this scene yet")
    certificate = active.certificate
    if certificate.certified:
        clear = "" if certificate.clearance is None else f" {proven_length(certificate.clearance)}"
        return badge_of("good", f"✓ certified{clear}")
    if certificate.status in (Status.IN_CONTACT, Status.TOO_CLOSE) and certificate.failures:
        worst = min(certificate.failures, key=lambda place: place.distance)
        return badge_of("bad", f"✕ {shortened(worst.other, 24)} {millimetres(worst.distance)}")
    return badge_of("bad", f"✕ {SHORT[certificate.status]}")


def badge_of(tint: str, text: str) -> str:
    """Return words that stand in the scene, as HTML: "good", "bad" or neither."""
    return f'<div class="hd-badge hd-{tint}">{html.escape(text)}</div>'
