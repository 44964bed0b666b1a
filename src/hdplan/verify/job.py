"""A job: for every stage the world that follows from the scene, the motion and its marks, and from nothing else.

A stage begins with what the stages before it left: the arm and the fingers at the motion's own row, what was taken held
as it stood then, what was let go standing where it was. So nobody can tell the checker another world than this one: a
proof has directions for its pairs alone. Where fingers move there are two worlds, one of the fingers and one of the arm
that stands still meanwhile, as a world compares nothing that does not move with its joints.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from . import scene as scenes
from .balls import RejectedError, named, need, rejecting
from .hands import Hands
from .job_curves import Corner, check_radius, corner_after, following, settled
from .joints import Joints
from .motion import Rows
from .reading import Reader, Reading
from .stages import ARM, Stage, stages_of
from .text import listing, mapping

SAME_TIME = 1e-6  # [s] by which a wait may be shorter


@dataclass(frozen=True)
class Part:
    """A world that is to be proven free: that of a stage, or of the arm that stands still in it."""

    name: str  # in words
    about: str  # what is held, and what may touch
    reading: Reading
    arm: bool  # whether it is that of the arm that stands still while fingers move
    holding: tuple[str, tuple[str, ...]] | None  # an object that is taken at its end, and what is to hold it
    drawn: bool  # along a curve, which is the checker's own: the proof's may have other chords


def read_job(scene: Path, motion: Path, claimed: list[Any], robot: str | None = None) -> list[Part]:
    """The worlds of a job, in order, of which a proof claims as many. Raises RejectedError, which names the stage."""
    with rejecting():
        reader = Reader(scene, motion, claimed[0] if claimed else None, None, robot)
        stages = stages_of(reader.top)
        count = sum(1 + stage.fingers for stage in stages)
        need(len(claimed) == count, f"the job has {count} worlds to be proven free, the proof has {len(claimed)}")
        return [*Job(reader, stages).parts()]


@contextmanager
def within(stage: Stage) -> Iterator[None]:
    """Name a stage in what is rejected."""
    try:
        yield
    except RejectedError as error:
        raise RejectedError(f"stage '{stage.name}': {error}") from None


class Job(Hands):
    """The state in which a stage begins, and the worlds that follow from it."""

    def __init__(self, reader: Reader, stages: list[Stage]) -> None:
        """Take what there is at first."""
        super().__init__(reader)
        self.stages, self.rows = stages, reader.rows
        self.corner: Corner | None = None  # of the stage before, if that is blended into this one
        self.marks = self.marks_of(reader.rows)
        ends = zip(stages, self.marks[1:], strict=True)
        self.stages = [replace(x, blend=0.0, stops=True) if x.blend and self.rows.rests(row) else x for x, row in ends]

    def marks_of(self, rows: Rows) -> list[int]:
        """The rows at which the stages begin, and the last row."""
        marks = [mapping(x, "stages", "name row outputs") for x in listing(rows.stages, f"{rows.path}: stages")]
        for i, stage in enumerate(self.stages):
            there = marks[i].get("name") if i < len(marks) else None
            need(there == stage.name, f"the motion's stage {i} is {there!r}, the job's is '{stage.name}'")
            sets = stage.content if stage.kind == "set" else {}
            same = json.dumps(marks[i].get("outputs", {}), sort_keys=True) == json.dumps(sets, sort_keys=True)
            need(same, f"stage '{stage.name}': the motion sets other outputs than the job")
        need(len(marks) == len(self.stages), "the motion has more stages than the job")
        found: list[Any] = [*(x.get("row") for x in marks), len(rows.given[0]) - 1]
        good = all(type(x) is int for x in found) and found[0] == 0
        need(good and all(a < b for a, b in itertools.pairwise(found)), "the rows at which stages begin must increase")
        return found

    def parts(self) -> Iterator[Part]:
        """The worlds of all stages."""
        for number, stage in enumerate(self.stages):
            rows = self.rows.between(self.marks[number], self.marks[number + 1])
            with within(stage):
                if self.corner is not None and stage.curve:
                    self.corner = settled(self, stage, self.corner, rows)
                found = [*self.worlds(number, rows)]
                self.advance(number, rows)
            yield from found

    # --- worlds -------------------------------------------------------------------------------------------------------

    def worlds(self, number: int, rows: Rows) -> Iterator[Part]:
        """The worlds of a stage."""
        stage, top, still = self.stages[number], self.reader.top, self.arm_at
        limits = stage.beside.get("limits", top.get("limits", {}))
        if stage.fingers:
            mine = stage.beside["limits"] if "limits" in stage.beside else of_fingers(limits)
            moved = self.of_fingers(stage)
            self.check_both(moved)
            yield self.part(stage, rows, limits=mine, **moved)
            only = {key: x for key, x in top.get("limits", {}).items() if key == "position"}
            rested = rows.still([*self.arm], [*self.arm.values()])
            yield self.part(stage, rested, limits=only, robot=self.bare, start=still, goal=still, arm=True)
            return
        for name, other in self.taken.items():
            words = f"'{name}' is held by '{self.held[name]['link']}' and '{other['link']}'"
            need(stage.kind not in ARM, f"{words}: one has to let go before an arm moves")
        if stage.kind not in ARM:
            need(not rows.moves(), "the robot moves where it is to stand still")
        if stage.kind == "wait":
            least = scenes.one(stage.content, "wait")
            need(rows.times[-1] - rows.times[0] >= least - SAME_TIME, f"waits for less than {least:g} s")
        aim: dict[str, Any] = {"goal": still}
        if stage.kind == "move":
            rates = {"velocity", "acceleration"} & {*stage.content}
            need(not rates, "move.velocity: with a job, whose stages end at rest")
            aim = {"goal": stage.content, "path": stage.beside.get("path", {})}
        elif stage.curve:
            aim = following(self, number)
        if stage.blend:
            passed = {x: rows.last(x) for x in self.arm}
            if stage.kind == "move":
                check_radius(self, number, passed)
            aim["goal"] = {"joints": [*passed.values()], **self.passing(rows)}
        yield self.part(stage, rows, limits=limits, robot=self.bare, start=still, **aim)

    def part(self, stage: Stage, rows: Rows, *, limits: Any, arm: bool = False, **sections: Any) -> Part:
        """The world of a scene in which a stage is a motion like any other."""
        top = self.reader.top
        limits = mapping(limits, "limits", "position velocity acceleration jerk torque")
        need(
            arm or "acceleration" in limits, "limits.acceleration: is missing, so that nothing rests where stages meet"
        )
        obstacles, attached = self.touching(stage)
        own: dict[str, Any] = {key: top[key] for key in ("planner", "self_collision") if key in top}
        own |= {"obstacles": obstacles, "attached": attached, "limits": limits, **sections}
        if "payload" in top and "torque" in limits:
            own["payload"] = top["payload"]
        if not arm:
            timing = top.get("timing", {})
            scale = scenes.one(timing.get("scale", 1.0), "timing") * scenes.one(stage.beside.get("speed", 1.0), "speed")
            own["timing"] = {**timing, "scale": scale}
        reader = self.reader.of(own, rows)
        world = reader.world()
        touch = ", ".join("-".join(map(named, pair)) for pair in stage.touch) or "nothing"
        into = f"; goes over into the next within {stage.blend:g} m" if stage.blend else ""
        into += "; stops, where the job blends it into the next" * stage.stops
        about = f"holds {', '.join(map(named, self.held)) or 'nothing'}; may touch, beside what it holds: {touch}{into}"
        name = f"stage {named(stage.name)}{', the arm that stands still' * arm}"
        read = reader.reading(world)
        holding = None if arm or stage.kind != "grip" or "object" not in stage.content else self.holding(stage)
        return Part(name, about, read, arm, holding, stage.curve)

    def passing(self, rows: Rows) -> dict[str, list[float]]:
        """The arm's rates at the last row, by as many as the motion has."""
        need(len(rows.given) > 1, "is to go over into the next stage, and the motion has no velocities")
        columns = [rows.names.index(x) for x in self.arm]
        found = (rows.given[1:][k][-1, columns].tolist() for k in range(len(rows.given) - 1))
        return dict(zip(("velocity", "acceleration"), found, strict=False))

    # --- what stages leave --------------------------------------------------------------------------------------------

    def advance(self, number: int, rows: Rows) -> None:
        """Go to what there is after a stage."""
        stage = self.stages[number]
        if stage.kind in ARM:
            self.corner = corner_after(self, number) if stage.blend else None
            self.rates = self.passing(rows) if stage.blend else {}
            self.arm = {x: rows.last(x) for x in self.arm}
        elif stage.kind in ("grip", "release"):
            if stage.fingers:
                task = self.of_fingers(stage)
                joints = Joints(task["robot"], task["start"], self.reader.joints.tree, self.reader.joints.semantics)
                moved = {x: rows.last(x) for x in joints.lead}
                moved |= {x: factor * moved[y] + add for x, (y, factor, add) in joints.rules.items()}
                self.hand |= moved
            if "object" in stage.content:
                (self.take if stage.kind == "grip" else self.let_go)(stage)


def of_fingers(limits: Any) -> dict[str, Any]:
    """Limits of the arm that hold for fingers: those that are for all joints."""
    given = {x: y for x, y in limits.items() if x in ("velocity", "acceleration", "jerk")}
    kept = {x: y for x, y in given.items() if type(y) in (int, float, str)}
    need({"acceleration", "jerk"} & {*given} <= {*kept}, "limits: by joints of the arm, which do not limit fingers")
    return kept
