"""There is a certificate only where everything that the scene asks was checked.

Whatever a check leaves out, of all that scenes can ask, is noticed and named; and scenes with everything at once, in
every combination, lack nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan import Attached, Box, Cloud, Limits, Obstacle, Payload, Pose, Scene, SelfCollision, Sphere, Trajectory
from hdplan.planner.certificate import certifier, path_bounds, path_check
from hdplan.planner.certificate.certifier import Certifier, certify
from hdplan.planner.certificate.coverage import UncheckedError
from hdplan.planner.certificate.end_check import EndCheck
from hdplan.planner.certificate.intervals import Bodies, Pairs
from hdplan.planner.certificate.limit_checks import LimitFinding
from hdplan.planner.certificate.rate_check import RateCheck
from hdplan.planner.certificate.solids import link_bodies, obstacle_bodies
from hdplan.planner.certificate.sweep import Sweep
from hdplan.planner.robot import scene_robot
from hdplan.planner.robot.setup import Setup

START = [0.0, -0.8, 0.0, -2.2, 0.0, 1.5, 0.8]
END = [0.3, -0.6, 0.2, -2.0, 0.0, 1.6, 0.7]
HANGING = Pose((0.0, 0.0, 1.5), (1.0, 0.0, 0.0, 0.0))
FAR = Pose((2.0, 0.0, 1.0))
POINTS = np.random.default_rng(0).normal(size=(200, 3)) * 0.02
FINGERS = ("panda_leftfinger", "panda_rightfinger")
EVERYTHING = {
    "obstacles": (
        Obstacle("box", Box([0.1, 0.1, 0.1]), FAR),
        Obstacle("own", Sphere(0.1), Pose((0.0, 2.0, 1.0)), clearance=0.05),
        Obstacle("panda_hand", Sphere(0.1), Pose((0.0, -2.0, 1.0))),  # as a link is called
        Obstacle("steady", Sphere(0.1), Pose((-2.0, 0.0, 1.0)), motion=hdplan.SteadyMotion((0.01, 0.0, 0.0))),
        Obstacle("timed", Sphere(0.1), motion=hdplan.TimedPoses([0.0, 1.0], [FAR, Pose((2.0, 0.1, 1.0))])),
        Obstacle("cloud", Cloud(POINTS, radius=0.01), Pose((1.9, 1.9, 1.0))),
        Obstacle("seen", Cloud([[0.0, 0.0, 1.45], [1.9, -1.9, 1.0]], radius=0.01, ignore_robot=0.05)),
    ),
    "attached": (Attached("cup", "panda_hand", Sphere(0.02), Pose((0.0, 0.0, 0.2)), FINGERS, mass=0.2),),
    "self_collision": SelfCollision(clearance=0.001),
    "limits": Limits(position={"panda_joint1": (-1.0, 1.0)}, velocity=2.0, acceleration=10.0, jerk=500.0, torque=200.0),
    "payload": Payload("panda_hand", 0.3),
    "path": hdplan.PathConstraints(
        hdplan.Upright("panda_hand", "z", 1.0),
        hdplan.Within("panda_hand", [9.0, 9.0, 9.0]),
        hdplan.Relative("panda_hand", "panda_link0", position_tolerance=1.0, orientation_tolerance=3.0),
    ),
    "timing": hdplan.Timing(duration=3.0),
    "planner": hdplan.PlannerSettings(clearance=0.01),
}


def scene(**fields: Any) -> Scene:
    return Scene(robot=hdplan.RobotSpec("panda", base=HANGING), start=START, goal=END, **fields)


def motion(of: Scene) -> Trajectory:
    """A foreign one: by minimum jerk along the straight line."""
    names = Setup.of(of).robot.joint_names
    times = np.linspace(0.0, 3.0, 31)
    u = times[:, None] / 3.0
    way = np.subtract(END, START)
    q = START + way * (10 * u**3 - 15 * u**4 + 6 * u**5)
    v = way * (30 * u**2 - 60 * u**3 + 30 * u**4) / 3.0
    a = way * (60 * u - 180 * u**2 + 120 * u**3) / 9.0
    return Trajectory(names, q, times=times, velocities=v, accelerations=a)


@pytest.fixture(scope="module")
def whole() -> tuple[Scene, Trajectory]:
    full = scene(**EVERYTHING)
    return full, motion(full)


def test_a_scene_with_everything_lacks_nothing(whole: tuple[Scene, Trajectory]) -> None:
    full, moved = whole
    found = Certifier(Setup.of(full)).certify(moved)
    assert found.certified, found.text
    assert certify(full, moved, required=0.0, check_ends=False).certified
    required = Certifier(Setup.of(full))._required
    assert {"payload", "attached.cup.mass", "obstacles.timed.motion", "self_collision"} <= required
    assert {f"limits.{each.name}" for each in dataclasses.fields(Limits)} <= required
    kept = "upright", "position", "relative.position_tolerance", "relative.orientation_tolerance"
    assert {f"path.{each}" for each in kept} <= required


@pytest.mark.parametrize("seed", range(12))
def test_parts_of_it_in_any_combination_lack_nothing(whole: tuple[Scene, Trajectory], seed: int) -> None:
    """Refused or not, the requirement is the one that was checked."""
    _, moved = whole
    rng = np.random.default_rng(seed)
    fields = {name: value for name, value in EVERYTHING.items() if rng.random() < 0.5}
    if "obstacles" in fields:
        fields["obstacles"] = tuple(each for each in EVERYTHING["obstacles"] if rng.random() < 0.5)  # type: ignore[attr-defined]
    if rng.random() < 0.3:
        fields["self_collision"] = SelfCollision(checked=False)
    part = scene(**fields)
    found = Certifier(Setup.of(part)).certify(moved, check_ends=bool(rng.random() < 0.5))
    assert found.certified, found.text
    with_more = Setup.of(dataclasses.replace(part, self_collision=SelfCollision())).robot
    assert certify(part, moved, with_more).certified  # a robot that is checked for more


def test_masses_on_links_that_stand_still_are_looked_at(whole: tuple[Scene, Trajectory]) -> None:
    """They load no joint, and count as checked all the same."""
    stone = Attached("stone", "panda_link0", Sphere(0.02), Pose((-1.0, 0.0, 0.0)), mass=0.2)
    still = scene(limits=Limits(torque=200.0), payload=Payload("panda_link0", 0.3), attached=[stone])
    assert certify(still, whole[1]).certified


@pytest.mark.parametrize(
    "name",
    ["planar_arm", "panda_cage", "panda_gate", "panda_cup", "panda_camera", "panda_heavy", "ur5_payload", "ur5_scan"],
)
def test_shipped_scenes_lack_nothing(name: str) -> None:
    shipped = hdplan.load_scene(name)
    setup = Setup.of(shipped)
    start = setup.robot.configuration(shipped.start, shipped.from_request)
    rows = np.tile(start, (3, 1))
    still = Trajectory(setup.robot.joint_names, rows, {}, [0.0, 1.0, 2.0], 0 * rows, 0 * rows)
    assert Certifier(setup).certify(still).status.value == "wrong_ends"


# --- what checks leave out --------------------------------------------------------------------------------------------


def without_bodies(name: str, own: bool) -> Callable[[pytest.MonkeyPatch], None]:
    def change(patch: pytest.MonkeyPatch) -> None:
        if own:
            made = link_bodies
            patch.setattr(certifier, "link_bodies", lambda robot: [each for each in made(robot) if each.name != name])
        else:
            of = obstacle_bodies
            patch.setattr(certifier, "obstacle_bodies", lambda each: [] if each.name == name else of(each))

    return change


def without_pairs(of: Callable[[Bodies, Pairs], Any]) -> Callable[[pytest.MonkeyPatch], None]:
    """Leave the first pair out for which `of` holds."""
    made = Pairs.of

    def fewer(bodies: Bodies, table: Any) -> Pairs:
        pairs = made(bodies, table)
        keep = np.ones(len(pairs.a), dtype=bool)
        keep[np.flatnonzero(of(bodies, pairs))[:1]] = False
        return Pairs(*(getattr(pairs, each.name)[keep] for each in dataclasses.fields(Pairs)))

    return lambda patch: patch.setattr(Pairs, "of", staticmethod(fewer))


def at_rest(patch: pytest.MonkeyPatch) -> None:
    made = obstacle_bodies
    still = lambda each: dataclasses.replace(each, motion=None) if each.name == "steady" else each  # noqa: E731
    patch.setattr(certifier, "obstacle_bodies", lambda each: made(still(each)))


def dropping(kind: type, method: str, change: Callable[[Any], Any]) -> Callable[[pytest.MonkeyPatch], None]:
    made = getattr(kind, method)
    return lambda patch: patch.setattr(kind, method, lambda self, *given: change(made(self, *given)))


def no_loads(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Setup, "loaded_model", property(lambda setup: setup.robot.model))


def fewer_uses(found: LimitFinding) -> LimitFinding:
    return dataclasses.replace(found, uses=tuple(use for use in found.uses if use.quantity != "jerk"))


def only_kept(count: int) -> Callable[[pytest.MonkeyPatch], None]:
    made = path_bounds.held_by
    return lambda patch: patch.setattr(path_check, "held_by", lambda setup: made(setup)[:count])


def at(name: str) -> Callable[[Bodies, Pairs], Any]:
    return lambda bodies, pairs: np.array([bodies.names[b] == name for b in pairs.b.tolist()]) & (pairs.group == 0)


FORGOTTEN: list[tuple[str, Callable[[pytest.MonkeyPatch], None]]] = [
    ("limits.jerk", dropping(RateCheck, "check", fewer_uses)),
    ("limits.torque", lambda patch: patch.setattr(certifier, "limit_checks", lambda setup: [RateCheck(setup)])),
    ("limits.velocity", lambda patch: patch.setattr(certifier, "limit_checks", lambda setup: [])),
    ("limits.position", lambda patch: patch.setattr(scene_robot, "_narrowed", lambda robot, ranges: robot)),
    ("payload", no_loads),
    ("attached.cup.mass", no_loads),
    ("attached.cup", without_bodies("cup", own=True)),
    ("robot: panda_link5", without_bodies("panda_link5", own=True)),
    ("obstacles.box", without_bodies("box", own=False)),
    ("obstacles.cloud", without_bodies("cloud", own=False)),
    ("obstacles.panda_hand", without_bodies("panda_hand", own=False)),
    ("obstacles.own", without_pairs(at("own"))),
    ("obstacles.seen", without_pairs(at("seen"))),
    ("obstacles.steady.motion", at_rest),
    ("obstacles.timed", without_pairs(at("timed"))),
    ("obstacles.own.clearance", dropping(Certifier, "floor", lambda floor: 0.0 * floor)),
    ("self_collision", without_pairs(lambda bodies, pairs: pairs.group == 1)),
    ("self_collision", dropping(Certifier, "floor", lambda floor: 0.0 * floor)),
    ("obstacles.box", dropping(Sweep, "prove", lambda proof: dataclasses.replace(proof, whole=False))),
    ("goal", dropping(EndCheck, "misses", lambda found: {x: y for x, y in found.items() if x != "goal"})),
    ("path.relative.orientation_tolerance", only_kept(3)),
    ("path.position", only_kept(1)),
    ("path.upright", lambda patch: patch.setattr(path_check, "PathCheck", lambda *_: None)),
]


@pytest.mark.parametrize(("name", "forget"), FORGOTTEN, ids=[f"{i}-{name}" for i, (name, _) in enumerate(FORGOTTEN)])
def test_a_requirement_that_a_check_leaves_out_is_named(
    name: str,
    forget: Callable[[pytest.MonkeyPatch], None],
    whole: tuple[Scene, Trajectory],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    full, moved = whole
    forget(monkeypatch)
    with pytest.raises(UncheckedError, match="no certificate: the scene requires") as error:
        Certifier(Setup.of(full)).certify(moved)
    named = str(error.value).removeprefix("no certificate: the scene requires ").partition(", which")[0]
    assert name in named.split(", ")


def test_unrequested_checks_are_named_too(whole: tuple[Scene, Trajectory], monkeypatch: pytest.MonkeyPatch) -> None:
    _, moved = whole
    dropping(EndCheck, "misses", lambda found: {**found, "middle": None})(monkeypatch)
    with pytest.raises(UncheckedError, match="checks cover middle, which the scene does not require"):
        certify(scene(), moved)


def test_a_motion_that_is_not_free_is_not_judged_either(
    whole: tuple[Scene, Trajectory], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A missing check fails for every motion, not only for one that would be certified."""
    _, moved = whole
    box = Box([0.3, 0.3, 0.3], name="met", pose=[0.3, 0.0, 0.9])
    met = scene(obstacles=[box], limits=Limits(jerk=500.0, acceleration=10.0))
    assert not certify(met, moved).certified
    dropping(RateCheck, "check", fewer_uses)(monkeypatch)
    with pytest.raises(UncheckedError, match=r"limits\.jerk"):
        certify(met, moved)
