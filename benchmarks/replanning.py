"""Replanning among people, boxes that come into sight, and a conveyor: what is touched, and how long a cycle takes.

    python benchmarks/replanning.py
        [--runs N] [--from SEED] [--seconds S] [--alone] [--trusting]

A Panda drives to one goal after the other, for S seconds (20) in each of N seeded worlds. A camera takes a picture
every 50 ms, which arrives 30 to 80 ms later; a step of the replanner is due every 40 ms, takes as long as the processor
takes here, and its command reaches the arm 10 ms later; the arm is up to `robot.tracking` off what is commanded. People
(spheres and capsules) go at up to 0.5 m/s and turn at will, some of them towards the robot; they do not give way to a
robot that moves, and turn back from one that stands. Boxes come into sight at 1.5 m, stand, and leave; others lie on a
conveyor. What the camera says is up to 1 cm off. Ways are looked for beside the steps, and come as late as the
processor takes for them.

Bodies that touch are found without hdplan: the robot's meshes and the world as it is, by Pinocchio and coal, every 5 ms
while any joint is faster than 1 mrad/s, wherever what was measured last and what both have gone since do not tell that
they are apart.

Each run is made again, with --alone, with nothing but the floor: no planner, whatever it knows, reaches more goals with
these commands. With --trusting, pictures hold no sizes, as if everything stood still where it is seen: these touch.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any

import numpy as np
from replanning_world import LAG, OFF, SIGHT, SPEED, Gaps, Judge, Rider, World, scene_of

import hdplan
from hdplan.planner.studies.report import markdown_text

PERIOD, LATENCY, SETTLING = 0.04, 0.01, 0.1  # [s]
PICTURES, SEEN_AFTER = 0.05, (0.03, 0.08)  # [s]
LAG_TIME = 0.03  # [s] in which a joint follows
NEAREST = 0.1  # [m] above which the distance of a robot that moves is not measured
NEAR = 0.03  # [m] at which a body turns back from a robot that stands
CHECK, MOVES = 0.005, 1e-3  # [s] between two looks; [rad/s] of a joint that moves


@dataclass(frozen=True)
class Outcome:
    """One run."""

    contacts: int  # looks at which a moving robot touched something
    least: float  # [m] between robot and obstacles, while it moved
    goals: int  # reached
    moving: float  # share of the time
    steps: list[float]  # [s] of each
    ways: list[float]  # [s] of each search for one
    pictures: list[float]  # [s] to take each
    late: int  # steps that took longer than their period
    causes: Counter[str]  # steps by what kept them from proving a motion


class Beside(Executor):
    """Looks for ways at once, and tells what it found as late as the processor took."""

    def __init__(self) -> None:
        self.now, self.spent = 0.0, 0.0
        self.seconds: list[float] = []
        self.open: list[tuple[float, Future[Any], Any]] = []

    def submit(self, work: Callable[..., Any], /, *args: Any, **named: Any) -> Future[Any]:
        began = time.process_time()
        found, future = work(*args, **named), Future[Any]()
        took = time.process_time() - began
        self.seconds.append(took)
        self.spent += took
        self.open.append((self.now + took, future, found))
        return future

    def advance(self, t: float) -> None:
        self.now = t
        for at, future, found in self.open:
            if at <= t:
                future.set_result(found)
        self.open = [each for each in self.open if each[0] > t]


class Arm:
    """Follows commands, up to a lag off in each joint."""

    def __init__(self, q: np.ndarray, speeds: np.ndarray, lag: float) -> None:
        self.q, self.dq, self.behind, self.speeds, self.lag = q, np.zeros(len(q)), np.zeros(len(q)), speeds, lag
        self.command: hdplan.Command | None = None
        self.samples: hdplan.Samples | None = None
        self.began = 0

    def take(self, command: hdplan.Command, look: int) -> None:
        """Execute a command from now on, at a look."""
        assert command.motion.times is not None
        ends = command.time + float(command.motion.times[-1])
        count = max(math.ceil(ends / CHECK) - look, 0) + 1
        self.command, self.began = command, look
        self.samples = command.at(np.maximum(CHECK * (look + np.arange(count)), command.time))

    def follow(self, look: int) -> None:
        if self.samples is None:
            return
        at = min(look - self.began, len(self.samples.positions) - 1)
        target = self.lag * self.samples.velocities[at] / self.speeds
        self.behind = self.behind + (target - self.behind) * (1.0 - math.exp(-CHECK / LAG_TIME))
        q = self.samples.positions[at] - np.clip(self.behind, -self.lag, self.lag)
        self.q, self.dq = q, (q - self.q) / CHECK


def cause(command: hdplan.Command, room: float, at_goal: float, due: float) -> str:
    """Return the cause that kept a step from proving a motion, by the words of its command; `room` [m] is left around
    the robot, `at_goal` around a robot at its goal, and `due` for a motion that ends at once."""
    if not command.why:
        return {"moving": "proven", "arrived": "at its goal"}.get(command.mode.value, "waits")
    if command.why.startswith("the step took"):
        return "late"
    if at_goal < due:
        return "goal within reach of others"
    if command.why.startswith("too close"):
        return "shut in" if room < due else "way is not free"
    return "no way"


def run(seed: int, seconds: float, off: float | None = OFF, empty: bool = False) -> Outcome:
    """Simulate one run with pictures that are `off` [m], or as far, but without sizes; `empty`: nothing is there."""
    scene, goals = scene_of(seed)
    world, beside = World(seed), Beside()
    if empty:
        world.walkers = []
    rng = np.random.default_rng([seed, 2])
    clock, steps, pictures, causes = [0.0], list[float](), list[float](), Counter[str]()

    def now() -> float:
        return clock[0] + time.process_time() - begun[0] - beside.spent

    begun = [0.0]
    replanner = hdplan.Replanner(scene, period=PERIOD, latency=LATENCY, settling=SETTLING, clock=now, executor=beside)
    judge = Judge(replanner.robot)
    gaps = Gaps(judge)
    speeds = np.array(replanner.robot.model.velocityLimit[:7])
    arm = Arm(replanner.robot.configuration(scene.start), speeds, LAG)
    coming: list[tuple[float, hdplan.Command]] = []  # commands on their way to the arm
    taken: list[tuple[float, float, list[hdplan.Obstacle]]] = []  # pictures on their way: arrival, time when taken
    next_step = next_picture = 0.0
    reached, contacts, least, moving, late = 0, 0, NEAREST, 0, 0
    count, seen_at = round(seconds / CHECK), 0.0
    for k in range(count):
        t = k * CHECK
        if t >= next_picture - 1e-9:
            next_picture += PICTURES
            seen = [each.seen(off) for each in world.there(t) if np.linalg.norm(each.at[:2]) <= SIGHT + 1e-6]
            taken.append((t + rng.uniform(*SEEN_AFTER), t, seen))
        if t >= next_step - 1e-9:
            next_step += PERIOD
            beside.advance(t)
            for come, at, seen in sorted(each for each in taken if each[0] <= t)[-1:]:
                began = time.process_time()
                replanner.update(obstacles=seen, at=at)
                pictures.append(time.process_time() - began)
                taken, seen_at = [each for each in taken if each[0] > come and each[1] > at], at
            if arm.command is not None:
                replanner.state(arm.q, np.clip(arm.dq, -arm.speeds, arm.speeds), at=t - CHECK)
            clock[0], begun[0], beside.spent = t, time.process_time(), 0.0
            found = replanner.step(t)
            took = now() - t
            steps.append(took)
            late += took > PERIOD
            coming.append((t + took + LATENCY, found))
            next_step = max(next_step, t + took)
            due = SPEED * (t - seen_at + LATENCY + 2.0 * PERIOD + SETTLING) + (off or 0.0)
            near = at_goal = due
            if gaps.at is not None and found.why:
                near = gaps.below(world.there(t), due)
                at_goal = judge.distance(goals[reached % len(goals)], world.there(t), due, floor=False)
            causes[cause(found, near, at_goal, due)] += 1
            if found.mode.value == "arrived":
                reached += 1
                replanner.aim(goals[reached % len(goals)])
        for at, found in coming:
            if at <= t:
                arm.take(found, k)
        coming = [each for each in coming if each[0] > t]
        arm.follow(k)
        gaps.move(arm.q, CHECK)
        if np.abs(arm.dq).max() > MOVES:
            moving += 1
            distance = gaps.below(world.there(t), max(least, 0.0) + 1e-9, floor=True)
            least = min(least, distance)
            contacts += distance <= 0.0
        elif k % 4 == 0:
            for each in world.there(t):
                if not isinstance(each, Rider) and t >= each.turned + 1.0 and gaps.below([each], NEAR) < NEAR:
                    each.turned = t
                    each.turn_back(t)
        world.go(t, CHECK, lambda: judge.hand(arm.q))
    ways = beside.seconds or [0.0]
    return Outcome(contacts, least, reached, moving / count, steps, ways, pictures, late, causes)


def _driven(runs: list[Outcome]) -> dict[str, Any]:
    """Return the results of runs of one kind for the robot."""
    causes = sum((each.causes for each in runs), Counter[str]())
    steps = causes.total() / 100
    return {
        "runs": len(runs),
        "with a contact while moving": sum(each.contacts > 0 for each in runs),
        "closest while moving, if within 100 [mm]": 1e3 * min(each.least for each in runs),
        **_reached(runs),
        "moving": f"{np.mean([each.moving for each in runs]):.0%}",
        "of 100 steps": ", ".join(f"{count / steps:.1f} {name}" for name, count in causes.most_common()),
    }


def _reached(runs: list[Outcome]) -> dict[str, Any]:
    goals = [each.goals for each in runs]
    return {"with a goal reached": sum(each > 0 for each in goals), "goals in a run": float(np.mean(goals))}


def table(outcomes: list[Outcome], trusting: list[Outcome], alone: list[Outcome]) -> str:
    """Return the results of all runs."""

    def quantile(name: str, share: float) -> float:
        return 1e3 * float(np.median([np.quantile(getattr(each, name), share) for each in outcomes]))

    longest = 1e3 * max(max(each.steps) for each in outcomes)
    first: dict[str, Any] = {
        "what is seen": "within its sizes",
        **_driven(outcomes),
        "cycle median / 99 % / longest [ms]": (
            f"{quantile('steps', 0.5):.1f} / {quantile('steps', 0.99):.1f} / {longest:.0f}"
        ),
        "late steps": sum(each.late for each in outcomes),
        "way median / 99 % [ms]": f"{quantile('ways', 0.5):.0f} / {quantile('ways', 0.99):.0f}",
        "picture median [ms]": quantile("pictures", 0.5),
    }
    rows, none = [first], dict.fromkeys(first)
    if trusting:
        rows.append(none | {"what is seen": "as it is"} | _driven(trusting))
    if alone:
        rows.append(none | {"what is seen": "nothing is there", "runs": len(alone)} | _reached(alone))
    return markdown_text(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--from", dest="first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--alone", action="store_true")
    parser.add_argument("--trusting", action="store_true")
    options = parser.parse_args()

    seeds, seconds = range(options.first, options.first + options.runs), options.seconds
    trusting = [run(seed, seconds, off=None) for seed in seeds] if options.trusting else []
    alone = [run(seed, seconds, empty=True) for seed in seeds] if options.alone else []
    print(table([run(seed, seconds) for seed in seeds], trusting, alone))


if __name__ == "__main__":
    main()
