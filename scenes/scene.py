"""A scene: one complete planning problem, as frozen data without files or geometry.

Lengths in metres, angles in radians, poses in the world unless stated otherwise. Every value is checked when an object
is made, whether by a file's reader or by a program (`values`); one that is not allowed raises an `InputError`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.errors import FieldError, nearest
from hdplan.scenes.job import Job
from hdplan.scenes.limits import QUANTITIES, Limits
from hdplan.scenes.obstacles import Obstacle, Seen, SelfCollision, obstacles_of
from hdplan.scenes.output import check_writable, write_output
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.robot_spec import RobotSpec, robot_spec
from hdplan.scenes.shapes import Solid
from hdplan.scenes.targets import AnyConfiguration, AnyGoal, Configuration, Goals, JointTarget, goal_of
from hdplan.scenes.timing import Timing
from hdplan.scenes.values import NEEDED, Checked, checked, path_of

SCENE_FILES = (".yaml", ".yml")


class FileRead(type(Path())):  # type: ignore[misc]  # PosixPath or WindowsPath, which Python 3.11 cannot derive from Path
    """The file that a scene was read from, as long as it stands there as it is; a changed copy has another `source`."""


@dataclass(frozen=True, repr=False)
class Scene(Checked):
    """One complete planning problem. Scenes with the same content are equal, whatever their files.

        scene = hdplan.Scene(
            robot="panda",
            obstacles=[hdplan.Box([0.1, 0.1, 0.6], pose=[0.6, 0.0, 0.3])],
            start="default",
            goal=[0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785],
        )

    Pass arguments by name. `robot` is a name listed by `hdplan robots`, or a RobotSpec. `obstacles` are Obstacles, or
    shapes with a pose. `start` is a row of joint values in the robot's order [rad or m], a mapping from joint names to
    values, the name of an SRDF state, or a State, which has a velocity, too. `goal` is one of these too, or a Pose or
    PoseTarget, or a list of alternatives; with a `job` it is left out, and reads as the start.
    The other arguments are the sections of a scene file.

    Raises InputError for any value that would be refused in a file, with the same message. Names of joints, links,
    states and robots, and the needs of one section from another, are checked when the scene is planned.
    """

    name: str = field(default="scene", compare=False)
    source: Path = field(default=Path(), compare=False, repr=False)
    # its file; without one, its name; in errors about a changed copy the file is not to blame
    robot: Annotated[RobotSpec, robot_spec] = NEEDED
    obstacles: Annotated[tuple[Obstacle, ...], obstacles_of] = ()
    start: Annotated[JointTarget, Configuration("start")] = NEEDED
    goal: Annotated[JointTarget | Goals, goal_of] = NEEDED
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    from_request: bool = False  # ends as in MoveIt requests: of whole robots, maybe a little beyond limits
    attached: tuple[Attached, ...] = ()
    self_collision: SelfCollision = field(default_factory=SelfCollision)
    limits: Limits = field(default_factory=Limits)
    payload: Payload | None = None
    path: PathConstraints = field(default_factory=PathConstraints)
    timing: Timing | None = None
    job: Job | None = None  # in place of a goal: stages, planned one after the other
    notes: tuple[str, ...] = field(default=(), compare=False)  # what the reader changed or left out

    if TYPE_CHECKING:

        def __init__(
            self,
            name: str = "scene",
            source: Path = Path(),
            robot: str | RobotSpec = NEEDED,
            obstacles: Sequence[Obstacle | Solid | Seen] = (),
            start: AnyConfiguration = NEEDED,
            goal: AnyGoal = NEEDED,
            planner: PlannerSettings = PlannerSettings(),
            from_request: bool = False,
            attached: Sequence[Attached] = (),
            self_collision: SelfCollision = SelfCollision(),
            limits: Limits = Limits(),
            payload: Payload | None = None,
            path: PathConstraints = PathConstraints(),
            timing: Timing | None = None,
            job: Job | None = None,
            notes: Sequence[str] = (),
        ) -> None: ...

    def __post_init__(self) -> None:
        """Check the fields; a copy of a scene that was read is no longer what its file says."""
        if isinstance(self.source, FileRead):
            object.__setattr__(self, "source", Path(f"the scene made from {self.source.stem}"))
        if self.goal is None and self.job is not None:
            object.__setattr__(self, "goal", self.start)
        super().__post_init__()

    def _check_whole(self) -> None:
        self._check_job()
        if self.source == Path():
            object.__setattr__(self, "source", Path(self.name))
        taken: dict[str, str] = {}
        named = [(f"obstacles[{i}]", "obstacle", obstacle.name) for i, obstacle in enumerate(self.obstacles)]
        named += [(f"attached[{i}]", "held object", held.name) for i, held in enumerate(self.attached)]
        for where, kind, name in named:
            if name in taken:
                other = f"{'earlier ' * (taken[name] == kind)}{taken[name]}"
                raise FieldError(f"the name {name!r} is taken by an {other}; names must differ", where)
            taken[name] = kind
        for i, obstacle in enumerate(self.obstacles):
            for each in obstacle.shape.ignore if isinstance(obstacle.shape, Cloud) else ():
                if each.obstacle is not None and taken.get(each.obstacle) != "obstacle":
                    others = [other.name for other in self.obstacles if other is not obstacle]
                    problem = f"unknown obstacle {each.obstacle!r}{nearest(each.obstacle, others)}"
                    raise FieldError(problem, f"obstacles[{i}].cloud.ignore")
        if self.robot.tracking is not None or self.robot.calibration is not None:
            size = "tracking" if self.robot.tracking is not None else "calibration"
            for name in (*self.path.given, *(["limits.torque"] if self.limits.torque is not None else [])):
                raise FieldError(f"is given, and no proof of {name} covers it: leave one of them out", f"robot.{size}")
        if self.robot.tracking is not None and self.robot.tracking.of_rates and not self.timed:
            raise FieldError(
                "only matters for a motion with times, but timing and limits are missing", "robot.tracking.velocity"
            )
        if self.robot.check_pairs and not self.self_collision.checked:
            raise FieldError("names pairs to check, but self_collision: false checks none", "robot.check_pairs")

    def _check_job(self) -> None:
        """Refuse what a job says stage by stage, and what nobody could prove of one."""
        if self.job is None:
            return
        if self.goal != self.start:
            raise FieldError("the stages of the job define the goals: leave it out", "goal")
        if self.start.velocity is not None:
            raise FieldError("applies to a single motion: every stage of a job begins at rest", "start.velocity")
        if self.path != PathConstraints():
            raise FieldError("belongs to the stages of a job: write it there", "path")
        if self.timing is not None and self.timing.duration is not None:
            raise FieldError("applies to one motion, and a job has several: leave it out", "timing.duration")
        if not self.self_collision.checked:
            raise FieldError(
                "false is not allowed with a job, whose objects are checked as links are", "self_collision"
            )
        if self.planner.objective == "energy":
            raise FieldError(
                "'energy' compares single motions; allowed with a job: time, smoothness", "planner.objective"
            )
        for i, obstacle in enumerate(self.obstacles):
            if obstacle.motion is not None:
                raise FieldError("depends on the time of a single motion", f"obstacles[{i}].motion")
            self._check_size(self.job, obstacle, f"obstacles[{i}].uncertainty")
        for key in ("tracking", "calibration"):
            if getattr(self.robot, key) is not None:
                raise FieldError("applies to single motions: no proof of a job covers it", f"robot.{key}")
        if self.from_request:
            raise FieldError("belongs to MoveIt's requests, which hold no job", "from_request")

    def _check_size(self, job: Job, obstacle: Obstacle, field: str) -> None:
        """Refuse an uncertain place of what a job holds or touches, and one that grows with the time."""
        if obstacle.uncertainty is None or not any(dataclasses.astuple(obstacle.uncertainty)):
            return
        if obstacle.uncertainty.speed:
            raise FieldError("applies to single motions, which have a time of their own", f"{field}.speed")
        if (stage := job.handling(obstacle.name)) is not None:
            raise FieldError(
                f"is given, and in the stage '{stage}' it is held or touched: its place must be known", field
            )

    def with_start(self, start: AnyConfiguration | Goals) -> Scene:
        """Return a copy of the scene with another start, in any form that `Scene` takes, or a goal without a choice.
        Raises InputError as `Scene` does."""
        goal = {} if self.job is None else {"goal": None}  # which reads as the start
        return dataclasses.replace(self, start=start, **goal)  # type: ignore[arg-type]

    def with_goal(self, goal: AnyGoal) -> Scene:
        """Return a copy of the scene with another goal, in any form that `Scene` takes. Raises InputError as `Scene`
        does."""
        return dataclasses.replace(self, goal=goal)  # type: ignore[arg-type]

    def with_obstacles(self, obstacles: Sequence[Obstacle | Solid | Seen]) -> Scene:
        """Return a copy of the scene with other obstacles in place of its own, in any form that `Scene` takes; with
        more by ``[*scene.obstacles, another]``. Raises InputError as `Scene` does."""
        return dataclasses.replace(self, obstacles=obstacles)  # type: ignore[arg-type]

    def save(self, path: str | Path) -> None:
        """Write the scene as a hdplan scene file, whole or not at all; `load_scene` gives an equal scene back.

        `path` ends with .yaml or .yml. Files that the scene names are written with absolute paths, so it may be
        saved anywhere. Raises InputError for another ending, a path that cannot be written, and a scene that no file
        can hold: with a section that needs another one, or a text with a lone surrogate.
        """
        import hdplan.scenes

        file = checked(path_of, path, "path")
        check_writable(file, SCENE_FILES)
        self.check_effects()
        write_output(file, hdplan.scenes.scene_text(self).encode())

    def check_effects(self) -> None:
        """Refuse sections that need another one: ends with a velocity without acceleration limits, a payload without
        torque limits or energy, moving obstacles without a duration, a timed motion with neither a duration nor
        acceleration limits, an objective without the data that it measures. Raises InputError."""
        for name, end in (("start", self.start), ("goal", self.goal)):
            if isinstance(end, JointTarget) and end.moves and self.limits.acceleration is None:
                raise FieldError(
                    "is not 0, but limits.acceleration is missing, which says how fast the robot may slow down",
                    f"{name}.velocity",
                )
        if self.payload is not None and self.limits.torque is None and self.objective != "energy":
            raise FieldError("only matters for joint torques, but limits.torque is missing", "payload")
        duration = self.timing.duration if self.timing else None
        for i, obstacle in enumerate(self.obstacles):
            if obstacle.motion is not None and duration is None:
                raise FieldError("needs known times, but timing.duration is missing", f"obstacles[{i}].motion")
            if obstacle.uncertainty is not None and obstacle.uncertainty.speed and duration is None:
                where = f"obstacles[{i}].uncertainty.speed"
                raise FieldError("needs known times, but timing.duration is missing", where)
        if self.timed and duration is None and self.limits.acceleration is None:
            given = next((name for name in QUANTITIES if getattr(self.limits, name) is not None), None)
            raise FieldError(
                "makes the motion timed, and a URDF has no acceleration limits: timing.duration or "
                "limits.acceleration is missing",
                "timing" if self.timing is not None or given is None else f"limits.{given}",
            )
        if self.planner.objective == "time" and (not self.timed or duration is not None):
            why = "timing.duration fixes it" if duration is not None else "limits.acceleration is missing"
            raise FieldError(
                f"'time' compares motions that may be faster or slower, but {why}; "
                f"allowed here: smoothness{', energy' * self.timed}",
                "planner.objective",
            )
        if self.planner.objective == "energy" and not self.timed:
            raise FieldError(
                "'energy' needs known times, but timing.duration or limits.acceleration is missing; "
                "allowed here: smoothness",
                "planner.objective",
            )

    @property
    def timed(self) -> bool:
        """True if the motion gets times: something in the scene depends on them."""
        return self.timing is not None or any(getattr(self.limits, rate) is not None for rate in QUANTITIES)

    @property
    def objective(self) -> str:
        """The quantity that is minimized: `planner.objective`, or else time where the motion may be faster or
        slower, and smoothness cost elsewhere."""
        return self.planner.objective or ("time" if self.timed and not self.end_time else "smoothness")

    @property
    def polish(self) -> int:
        """Number of rounds that try to improve the first motion: `planner.polish`, or else as many as bring most of the
        gain: two where time is the objective, one for smoothness, and none for energy."""
        rounds = self.planner.polish
        return {"time": 2, "smoothness": 1, "energy": 0}[self.objective] if rounds is None else rounds

    @property
    def standing(self) -> tuple[Obstacle, ...]:
        """The static obstacles."""
        return tuple(obstacle for obstacle in self.obstacles if not obstacle.moves)

    @property
    def moving(self) -> tuple[Obstacle, ...]:
        """The obstacles that move, or may."""
        return tuple(obstacle for obstacle in self.obstacles if obstacle.moves)

    @property
    def end_time(self) -> float:
        """The duration of the motion [s] if the scene fixes it, else 0."""
        return 0.0 if self.timing is None or self.timing.duration is None else self.timing.duration

    @property
    def clearances(self) -> dict[str, float]:
        """The clearance to be proven around each obstacle [m]: its own, or else planner.clearance."""
        return {
            obstacle.name: self.planner.clearance if obstacle.clearance is None else obstacle.clearance
            for obstacle in self.obstacles
        }


def unknown_in(scene: Scene) -> Iterator[str]:
    """Yield the fields of a scene that say how large something unknown is, where it is more than 0."""
    given = {f"obstacles[{i}].uncertainty": each.uncertainty for i, each in enumerate(scene.obstacles)}
    given |= {"robot.tracking": scene.robot.tracking, "robot.calibration": scene.robot.calibration}  # type: ignore[dict-item]
    for where, sizes in given.items():
        names = () if sizes is None else [each.name for each in dataclasses.fields(sizes)]
        yield from (f"{where}.{name}" for name in names if getattr(sizes, name) != 0.0)


def derived(scene: Scene, **changes: Any) -> Scene:
    """Return a scene with changes of our own, not the user's: of what is wrong in it, its file still is to blame."""
    found = dataclasses.replace(scene, **changes)
    object.__setattr__(found, "source", scene.source)
    return found


def as_read(scene: Scene, file: Path) -> Scene:
    """Mark a scene as read from a file."""
    object.__setattr__(scene, "source", FileRead(file))
    return scene
