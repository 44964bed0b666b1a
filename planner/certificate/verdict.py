"""The verdict of a certificate on a motion.

From what the checks found, the worst first, to one status and one sentence: what was found, where, and what to do.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from decimal import ROUND_CEILING, ROUND_DOWN, Context, Decimal
from enum import Enum
from typing import TYPE_CHECKING, Protocol

from hdplan.planner.motion.curve import Curve
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.values import FilePath

if TYPE_CHECKING:
    from hdplan.planner.certificate.limit_checks import LimitFinding, Use
    from hdplan.planner.certificate.path_check import Departure, Kept


class Status(Enum):
    """The verdict; `remedy` is advice."""

    CERTIFIED = "certified"
    WRONG_ENDS = "wrong_ends"
    OUTSIDE_LIMITS = "outside_limits"
    IN_CONTACT = "in_contact"
    TOO_CLOSE = "too_close"
    OFF_PATH = "off_path"
    TOO_FAST = "too_fast"
    OVERLOADED = "overloaded"
    NOT_PROVEN = "not_proven"

    @property
    def remedy(self) -> str:
        """Advice to the user."""
        return {
            Status.CERTIFIED: "none needed",
            Status.WRONG_ENDS: "plan from the scene's start to its goal, or check against the scene of its plan",
            Status.OUTSIDE_LIMITS: "keep every waypoint within the robot's joint limits",
            Status.IN_CONTACT: "plan with more clearance, more waypoints or another seed",
            Status.TOO_CLOSE: "require less clearance, or plan with more",
            Status.OFF_PATH: "allow more (path), or plan with this constraint in the scene, or with more waypoints",
            Status.TOO_FAST: "give it more time (timing), or plan with these limits in the scene",
            Status.OVERLOADED: "carry less, give it more time (timing), or plan with limits.torque in the scene",
            Status.NOT_PROVEN: "the motion grazes a body: plan with more clearance",
        }[self]


@dataclass(frozen=True)
class Place:
    """A place on the motion where two bodies are close."""

    interval: int  # between waypoints `interval` and `interval` + 1
    fraction: float  # of that interval, 0 to 1
    parameter: float  # of the whole motion, 0 to 1
    seconds: float | None  # when; None for a path without times
    link: str
    other: str  # an obstacle or another link
    distance: float  # [m] found there, negative in contact (minus the depth, 0 if unknown)
    unknown: float = 0.0  # [m] taken off for the scene's uncertainties: nominally the two are so much farther apart

    @property
    def words(self) -> str:
        """The distance, such as "3.2 mm", and what is unknown of it."""
        less = f" ({(self.distance + self.unknown) * 1e3:.3g} mm less the uncertainty)" if self.unknown else ""
        return f"{self.distance * 1e3:.3g} mm{less}"


class ProofFile(Protocol):
    """A proof, as `planner.proof` makes it."""

    @property
    def data(self) -> bytes:
        """The file's content."""

    @property
    def text(self) -> str:
        """The proven statement, in the checker's words."""

    def save(self, path: FilePath) -> None:
        """Write the file."""


@dataclass(frozen=True)
class Certificate:
    """A verdict on a continuous motion."""

    status: Status
    text: str  # one sentence: what was found, where, and what to do
    clearance: float | None  # [m] proven lower bound, robot to obstacles; None without obstacles or without proof
    self_clearance: float | None  # [m] proven lower bound between links; None without proof
    worst: Place | None  # the closest place found between robot and obstacles
    self_worst: Place | None  # the closest place found between links
    failures: tuple[Place, ...]  # every waypoint interval and pair that is not proven, with the worst place found there
    uses: tuple[Use, ...]  # shares of the limits on rates and torques that the motion takes
    path: tuple[Kept, ...]  # how well the scene's path constraints are kept, if it has any
    departures: tuple[Departure, ...]  # every waypoint interval and path constraint that is not proven
    overloaded: tuple[int, ...]  # every waypoint interval in which gravity alone overloads a joint
    configurations: int  # number of configurations at which distances were computed
    exact_calls: int  # number of calls of the exact distance
    seconds: float  # time of the check [s]
    required: float  # [m] of clearance, to obstacles without one of their own
    notes: tuple[str, ...] = ()  # notes on reduced clearance, holes in meshes, masses and points left out
    prover: Callable[[], ProofFile] | None = field(default=None, repr=False, compare=False)  # of a motion's proof

    @property
    def proof(self) -> ProofFile:
        """The certificate of a planned motion as a file that others check (`hdplan.verify`); made on first use.

        The proof refers to two files: the scene's, or one as `result.requested.save` writes if no file has this
        content; and the motion's, as `result.save` writes in JSON. Raises InputError for contents that a proof cannot
        hold, and for a certificate of another motion (`hdplan.prove`); NotProvenError where there is none.
        """
        if self.prover is None:
            raise InputError(
                "proof: only the certificate of a planned motion has one; hdplan.prove takes any motion's file"
            )
        return self.prover()

    def __repr__(self) -> str:
        """The verdict, for display."""
        return f"<Certificate: {self.text}>"

    @property
    def unproven(self) -> tuple[int, ...]:
        """The waypoint intervals in which clearance, path constraints or gravity loads are not proven, in order."""
        places = {place.interval for place in self.failures} | {place.interval for place in self.departures}
        return tuple(sorted(places | set(self.overloaded)))

    @property
    def certified(self) -> bool:
        """True if the motion is proven free."""
        return self.status is Status.CERTIFIED


@dataclass(frozen=True)
class Contact:
    """Two bodies that touch at one configuration."""

    link: str
    other: str  # an obstacle or another link
    depth: float  # [m] how far they overlap, 0 where only the contact is known


@dataclass(frozen=True, eq=False)
class Closest:
    """The two closest bodies at one configuration."""

    link: str
    other: str  # an obstacle or another link
    to_obstacle: bool  # whether it is an obstacle, which may have the name of a link
    distance: float  # [m] exact; negative in contact (then minus the depth, 0 if unknown)
    points: Array  # (2, 3) [m] the closest points, on the link and on the other: for pictures, not proven


@dataclass(frozen=True)
class Findings:
    """Findings of all checks of one motion."""

    curve: Curve
    ends: str | None  # how it misses the scene's start or goal
    beyond: str | None  # where it leaves the joint limits
    failures: tuple[Place, ...]  # where bodies are too close, or not proven to be apart
    touching: tuple[bool, ...]  # for each, whether it was found too close; otherwise it only could not be proven
    required: tuple[float, ...]  # for each, the clearance required there [m]
    departures: tuple[Departure, ...]
    limits: tuple[LimitFinding, ...]


def complaints(found: Findings) -> Iterator[tuple[Status, str]]:
    """Yield everything that keeps a motion from being certified, the most serious first."""
    if found.ends:
        yield Status.WRONG_ENDS, found.ends
    if found.beyond:
        yield Status.OUTSIDE_LIMITS, found.beyond
    places = list(zip(found.failures, found.required, found.touching, strict=True))
    others = _others(found.failures)
    # contacts first, then the places that fall short of the required clearance by most
    short = [(place, required) for place, required, touching in places if touching]
    for place, required in sorted(short, key=lambda each: (each[0].distance > 0.0, each[0].distance - each[1]))[:1]:
        if place.distance + place.unknown <= 0.0:
            yield Status.IN_CONTACT, f"{_approach(place)}; {others}"
        else:
            yield Status.TOO_CLOSE, f"{_approach(place)}, {required * 1e3:.4g} mm are required; {others}"
    if found.departures:
        worst = max(found.departures, key=lambda place: place.excess)
        status = Status.OFF_PATH if worst.violated else Status.NOT_PROVEN
        yield status, _departure(worst, found.departures, found.curve)
    for place, _, _ in sorted(places, key=lambda each: each[0].distance - each[1])[:1]:
        yield Status.NOT_PROVEN, f"{_where(place, 'cannot be separated')}; {others}"
    for limits in found.limits:
        yield from limits.complaints


def proven(
    clearance: float | None,
    self_clearance: float | None,
    limits: Sequence[LimitFinding],
    path: Sequence[Kept],
    sized: bool = False,
) -> str:
    """Return the claims, in words, proven about a certified motion; clearances [m]. `sized`: in all worlds within the
    scene's sizes."""
    obstacles = (
        "no obstacles to avoid" if clearance is None else f"at least {proven_length(clearance)} to every obstacle"
    )
    links = "" if self_clearance is None else f", {proven_length(self_clearance)} between links"
    uses = [use for found in limits if not found.remark for use in found.uses]
    taken = "".join(f", {use.quantity} up to {share_of_limit(use.share)} of the limits" for use in uses)
    kept = "".join(f", {constraint.words}" for constraint in path)
    remarks = "".join(f"; {found.remark}" for found in limits if found.remark)
    worlds = ", in every world within the scene's sizes" if sized else ""
    return f"{obstacles}{links}{taken}{kept}, over the whole motion{worlds}{remarks}"


def _approach(place: Place) -> str:
    if place.unknown:
        return _where(place, f"may come within {place.words}" if place.distance > 0.0 else _may_overlap(place))
    if place.distance < 0.0:
        return _where(place, f"overlap by {-place.distance * 1e3:.3g} mm")
    return _where(place, f"come within {place.distance * 1e3:.3g} mm" if place.distance else "touch")


def _may_overlap(place: Place) -> str:
    apart = place.distance + place.unknown
    text = f"are {apart * 1e3:.3g} mm apart" if apart > 0.0 else f"overlap by {-apart * 1e3:.3g} mm"
    return f"{text}, with {place.unknown * 1e3:.3g} mm unknown,"


def _where(place: Place, what: str) -> str:
    when = _when(place.parameter, place.seconds)
    return f"{place.link} and {place.other} {what} after waypoint {place.interval} ({when})"


def _when(parameter: float, seconds: float | None) -> str:
    return f"at {parameter:.3f} of 1" if seconds is None else f"{seconds:.3f} s"


def proven_length(metres: float) -> str:
    """Return a length that is proven, rounded down: no more is claimed than was proven."""
    digits = Context(prec=3, rounding=ROUND_DOWN).create_decimal(Decimal(metres) * (1000 if metres < 1.0 else 1))
    return f"{float(digits):.3g} {'mm' if metres < 1.0 else 'm'}"


def at_most(value: float) -> str:
    """Return an upper bound that is proven, rounded up to three digits: no less is claimed than was proven."""
    if not math.isfinite(value):
        return f"{value:g}"
    return f"{float(Context(prec=3, rounding=ROUND_CEILING).create_decimal(repr(value))):.3g}"


def share_of_limit(share: float, decimals: int = 0) -> str:
    """Return the share of a limit that is used at most, in per cent, rounded up but for the last digits of a double."""
    if not math.isfinite(share):
        return f"{share:.0%}"
    units = 10**decimals
    return f"{math.ceil(100.0 * units * share - 1e-6) / units:.{decimals}f}%"


def _others(failures: tuple[Place, ...]) -> str:
    pairs = Counter((place.link, place.other) for place in failures)
    intervals = len({place.interval for place in failures})
    return (
        f"{intervals} interval{'s' * (intervals != 1)} between waypoints, {len(pairs)} pair{'s' * (len(pairs) != 1)} "
        "of bodies not proven"
    )


def _departure(worst: Departure, departures: tuple[Departure, ...], curve: Curve) -> str:
    when = _when(worst.parameter, None if curve.times is None else float(curve.time_of(worst.parameter)))
    intervals = len({place.interval for place in departures})
    return (
        f"{worst.words}{'' if worst.violated else ', too close to decide'} after waypoint {worst.interval} ({when}); "
        f"{intervals} interval{'s' * (intervals != 1)} between waypoints not proven"
    )
