"""The panel's advice on the next step, and a motion's line in short."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hdplan.planner.certificate.verdict import Status, proven_length
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.motion import ShownMotion, Tip, millimetres
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.words import OUTDATED, SHORT, badge, figures, whats_next
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from tests.planner.view.events import straight


def shown(edited: Edited, trajectory: Trajectory) -> ShownMotion:
    return ShownMotion.of("a", trajectory, edited.certifier, measured=False)


@pytest.fixture
def edited(scene: Scene) -> Edited:
    return Edited.of(Setup.of(scene))


def test_without_a_motion_the_first_thing_is_plan(edited: Edited) -> None:
    assert whats_next(edited, None) == "no motion yet: press Plan"


def test_of_a_certified_motion_it_says_what_is_proven(edited: Edited, trajectory: Trajectory) -> None:
    motion = shown(edited, trajectory)
    assert whats_next(edited, motion) == motion.certificate.text
    assert figures(motion.certificate, trajectory).split(" · ") == [
        "certified",
        proven_length(motion.certificate.clearance or 0.0),
        "path",
    ]


def test_a_moved_end_is_named(edited: Edited, trajectory: Trajectory) -> None:
    for end, moved in (
        ("goal", edited.ending_at(edited.goal + [0.0, 0.01][: len(edited.goal)])),
        ("start", edited.starting_at(edited.start + [0.0, 0.01][: len(edited.start)])),
    ):
        assert whats_next(moved, shown(edited, trajectory)) == OUTDATED
        words = whats_next(moved, shown(moved, trajectory))
        assert words == f"planned for another {end}: press Plan"


def test_a_stopped_plan_says_how_far_it_came(edited: Edited, trajectory: Trajectory, scene: Scene) -> None:
    line = straight(trajectory)
    motion = shown(edited, line)
    assert motion.certificate.status is Status.IN_CONTACT
    result = replace(plan(scene), certificate=motion.certificate, requested=edited.scene)
    assert whats_next(edited, motion, result, stopped=True) == "stopped: the best motion so far is in contact"
    assert "no free motion found yet" in whats_next(edited, motion, result)
    worst = min(place.distance for place in motion.certificate.failures)
    text = f"in contact in this scene: forearm and ball, {-1e3 * worst:.1f} mm deep: press Plan"
    assert whats_next(edited, motion) == text
    assert figures(motion.certificate, line).startswith("in contact · ")


def test_an_end_in_collision_comes_before_everything_else(edited: Edited, trajectory: Trajectory) -> None:
    place = Pose(tuple(Tip.of(edited.robot).placement(edited.goal).translation.tolist()))
    moved = edited.changed(obstacles=(replace(edited.scene.obstacles[0], pose=place),))
    assert moved.contacts[1]
    assert whats_next(moved, shown(moved, trajectory)).startswith("goal is in collision: ")


def test_every_verdict_has_a_short_name() -> None:
    assert set(SHORT) == set(Status)
    assert max(map(len, SHORT.values())) < 25  # of one line


def test_the_badge_says_the_verdict_in_a_few_words(edited: Edited, trajectory: Trajectory, scene: Scene) -> None:
    """Nothing without a motion, and no tick where nothing is known."""
    line = straight(trajectory)
    certified, colliding = (ShownMotion.of("", each, edited.certifier) for each in (trajectory, line))
    assert badge(edited, None, False) == ""
    assert certified.certificate.clearance is not None
    text = badge(edited, certified, True)
    assert f"✓ certified {proven_length(certified.certificate.clearance)}<" in text
    assert "✓" not in badge(edited, certified, False)
    assert "not checked" in badge(edited, certified, False)
    worst = min(colliding.certificate.failures, key=lambda place: place.distance)
    assert f"✕ {worst.other} {millimetres(worst.distance)}" in badge(edited, colliding, True)
    assert "hd-bad" in badge(edited, colliding, True)
    ball = replace(scene.obstacles[0], pose=Pose(tuple(certified.tip[-1].tolist())))
    blocked = edited.changed(obstacles=(ball,))
    assert "✕ goal in collision" in badge(blocked, certified, False)
