"""`hdplan view`: show a scene and motions in the browser, or write them as one page, or as a film."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.terminal.console import printing, waiting
from hdplan.planner.terminal.declared import GivenScene
from hdplan.planner.terminal.interrupts import until_ctrl_c
from hdplan.planner.terminal.session import complain
from hdplan.planner.terminal.tables import table
from hdplan.planner.view.front import check_files, check_installed, check_proof, is_loopback, motion_names
from hdplan.planner.view.watch import Seen, Source, Watch, seen, seen_meshes
from hdplan.scenes.errors import HdplanError, InputError, naming
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import find_scene

if TYPE_CHECKING:
    from hdplan.planner.view.gate import Served

LOADING = "loading the robot's meshes"
HOST, PORT = "127.0.0.1", 8080  # unless others are given: this machine alone


class Place(NamedTuple):
    """The place where a viewer is served."""

    host: str
    port: int
    share: bool  # whether others may watch


def run_view(
    scene: GivenScene,
    trajectories: Sequence[Path] | None,
    *,
    proof: Path | None,
    record: Path | None,
    video: Path | None,
    host: str | None,
    port: int | None,
    share: bool = False,
) -> int:
    """Serve until Ctrl-C, or write the page `record` and the film `video`. Returns the exit code: 0."""
    trajectories = trajectories or []
    if record is not None or video is not None:
        served = {"--host": host, "--port": port, "--proof": proof, "--share": share or None}
        check_files(record, video, trajectories, [option for option, value in served.items() if value is not None])
        return _write(scene.load(), trajectories, record, video)
    files = seen([find_scene(scene.scene), *([] if scene.request is None else [scene.request])])
    problem = scene.load()
    meshes = seen_meshes(problem)
    check_installed()
    place = Place(HOST if host is None else host, PORT if port is None else port, share)
    if problem.job is not None:
        if proof is not None:
            raise InputError(f"--proof: {proof} is drawn for a single motion, and this scene holds a job: leave it out")
        return _serve_job(problem, scene.load, files, meshes, trajectories, place)
    if proof is not None:
        check_proof(proof, trajectories, scene.robot)
    motion_files = seen(trajectories)
    motions = _loaded(trajectories)
    read = None
    if proof is not None:
        from hdplan.planner.proof.reading import ReadProof

        read = ReadProof(find_scene(scene.scene), trajectories[0], proof, scene.request, scene.robot_file)

    from hdplan.planner.view.server import open_viewer  # needs viser

    with contextlib.ExitStack() as loading:
        loading.enter_context(waiting(LOADING))
        arm = load_scene_robot(problem)

        def found(viewer: Served) -> None:
            loading.close()
            _tell(problem, viewer, place)

        with until_ctrl_c():
            viewer = open_viewer(problem, motions, robot=arm, complain=complain, found=found, **place._asdict())
            with contextlib.closing(viewer):
                if read is not None:
                    viewer.show_proof(read)
                watch = viewer.panel.opening.follow(
                    scene.load,
                    files,
                    meshes,
                    {name: {file: motion_files[file]} for (name, _), file in zip(motions, trajectories, strict=True)},
                )
                with contextlib.closing(watch):
                    threading.Event().wait()
    return 0


def _tell(problem: Scene, viewer: Served, place: Place) -> None:
    """Write where a viewer is found."""
    with printing() as show:
        taken = f" (port {place.port} is taken)" if viewer.port != place.port else ""
        show(f"{problem.name} at {viewer.address()}{taken}, until Ctrl-C")
        if place.share:
            where = f" (from this machine alone, as it listens at {place.host})" if is_loopback(place.host) else ""
            show(f"to watch, and change nothing: {viewer.address(watch=True)}{where}")
    sys.stdout.flush()


def _serve_job(
    problem: Scene, load: Callable[[], Scene], files: Seen, meshes: Seen, trajectories: Sequence[Path], place: Place
) -> int:
    """Serve a job until Ctrl-C, and follow its files. Returns the exit code: 0."""
    from hdplan.planner.view.server import open_job_viewer  # needs viser

    motion_files = seen(trajectories)
    motion = _one_motion(problem, _loaded(trajectories))[1] if trajectories else None
    with waiting(LOADING):
        viewer = open_job_viewer(problem, motion, complain=complain, **place._asdict())

    def read_motion() -> None:
        try:
            viewer.take_motion(Trajectory.load(trajectories[0]))
        except HdplanError as error:
            viewer.refuse(error)

    sources = [Source.of_scene(files, meshes, load, viewer.take_scene, viewer.refuse)]
    if trajectories:
        sources.append(Source(motion_files, read_motion))
    with contextlib.closing(viewer), contextlib.closing(Watch(sources)), until_ctrl_c():
        _tell(problem, viewer, place)
        threading.Event().wait()
    return 0


def _one_motion(scene: Scene, loaded: list[tuple[str, Trajectory]]) -> tuple[str, Trajectory]:
    """Return the motion of a job, with its name. Raises InputError for several."""
    if len(loaded) > 1:
        raise InputError(f"{scene.source}: job: one motion at a time is shown of a job, {len(loaded)} are given")
    return loaded[0]


def _loaded(trajectories: Sequence[Path]) -> list[tuple[str, Trajectory]]:
    names = motion_names(trajectories)
    return [(name, Trajectory.load(file)) for name, file in zip(names, trajectories, strict=True)]


def _write(scene: Scene, trajectories: Sequence[Path], record: Path | None, video: Path | None) -> int:
    """Write the motions as files. Returns the exit code: 0."""
    loaded = _loaded(trajectories)
    if scene.job is not None:
        return _write_job(scene, loaded, record, video)

    from hdplan.planner.certificate.certifier import Certifier
    from hdplan.planner.page.film import film
    from hdplan.planner.page.recorded_page import page_of
    from hdplan.planner.robot.setup import Setup
    from hdplan.planner.view.drawing.motion import ShownMotion

    with printing() as show:
        with waiting(LOADING):
            setup = Setup.of(scene)
        certifier = Certifier(setup)
        motions = []
        for name, trajectory in loaded:
            with naming(name):
                motions.append(ShownMotion.of(name, trajectory, certifier))
        rows = []
        if record is not None:
            page_of(setup, motions).save(record)
            rows.append(("written", str(record)))
        if video is not None:
            with waiting("drawing the film"):
                drawn = film(setup, motions, video)
            rows.append(("written", f"{video}, drawn {drawn}"))
        show(table(rows))
    return 0


def _write_job(scene: Scene, loaded: list[tuple[str, Trajectory]], record: Path | None, video: Path | None) -> int:
    """Write the motion of a job as files. Returns the exit code: 0."""
    from hdplan.planner.job.certify import certify_job
    from hdplan.planner.page.film import film
    from hdplan.planner.page.job_page import ShownJob

    name, trajectory = _one_motion(scene, loaded)
    rows = []
    with printing() as show:
        with waiting(LOADING), naming(name):
            shown = ShownJob(scene, trajectory, certify_job(scene, trajectory))
            page = shown.page
        if record is not None:
            page.save(record)
            rows.append(("written", str(record)))
        if video is not None:
            with waiting("drawing the film"):
                drawn = film(shown.setup, [shown.motion], video, page)
            rows.append(("written", f"{video}, drawn {drawn}"))
        show(table(rows))
    return 0
