"""The FCL baseline: its exact signed distance, in a process of its own because it may crash.

In: two bodies and their poses, world from body [m]. Out: the answers of python-fcl as they are, positive = separated.
At random poses they are exact up to rounding. Where bodies just touch, FCL calls std::terminate in 0.1 % of poses
(Platonic solids; 2 % with thin plates), which Python cannot catch, and in 0.2 % it is wrong, by up to metres.
``fcl_distances`` marks the former and continues; ``FclPair`` is for timing. The package is optional (extra ``bench``)
and loaded where it is used.

Every body is a ``fcl.Convex`` of its vertices, and the radii are subtracted from the distance, as in
``signed_distance``. FCL's own round shapes are less accurate: with Sphere and Capsule its iteration stops up to 0.6 mm
away from the distance. Nor is a box any faster as ``fcl.Box``.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.distance.baselines.surface import triangles
from hdplan.distance.bodies import ConvexBody, check_bodies
from hdplan.distance.poses import check_pose_lists
from hdplan.distance.unions import Body, pairs_of
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.errors import InputError

ANSWER = np.dtype([("done", "?"), ("distance", "f8"), ("point_a", "f8", 3), ("point_b", "f8", 3)])  # of the polytopes
CRASH_SIGNALS = (signal.SIGABRT, signal.SIGSEGV)  # the signals by which FCL crashes
CHILD = "import sys; from hdplan.distance.baselines.fcl import _answer_all; _answer_all(sys.argv[1])"


@dataclass(frozen=True, eq=False)
class FclAnswers:
    """FCL's answers at N poses; NaN where it gives none."""

    distances: Array  # (N,) [m] positive = separated, negative = penetration depth
    points_a: Array  # (N, 3) [m] closest points on A, in the world; for swept bodies NaN where the normal is
    points_b: Array  # (N, 3) [m] and on B
    normals: Array  # (N, 3) unit, from B to A; NaN also where FCL's two points on the polytopes are one
    aborted: Mask  # (N,) FCL crashed there


class FclPair(threading.local):
    """Two bodies for FCL's signed distance in this process, with as little overhead as possible. For timing only.

    Threads may share it, as each has its own FCL objects. Beware: FCL crashes the whole process in some poses with a
    gap below about 1e-6 m. Raises InputError if python-fcl is not installed.
    """

    def __init__(self, body_a: ConvexBody, body_b: ConvexBody) -> None:
        """Build FCL's objects once. Raises InputError for unions: they are several pairs."""
        check_bodies(body_a, body_b)
        self._fcl = fcl = _library()
        self._placed = tuple(fcl.CollisionObject(_shape(body), fcl.Transform()) for body in (body_a, body_b))
        self._request = fcl.DistanceRequest(enable_nearest_points=True, enable_signed_distance=True)
        self._radii = body_a.radius + body_b.radius
        self._unfilled = fcl.DistanceResult(-np.inf)  # a result that is already closer: nothing is copied into it

    def distance(self, pose_a: Array, pose_b: Array) -> float:
        """Return FCL's signed distance [m] at poses (4, 4), world from body [m]."""
        a, b = self._at(pose_a, pose_b)
        return float(self._fcl.distance(a, b, self._request, self._unfilled)) - self._radii

    def polytopes(self, pose_a: Array, pose_b: Array) -> tuple[float, Array, Array]:
        """Return FCL's signed distance of the polytopes, radii left on, and its closest points (3,) on A and B [m]."""
        a, b = self._at(pose_a, pose_b)
        result = self._fcl.DistanceResult()
        distance = self._fcl.distance(a, b, self._request, result)
        return distance, *result.nearest_points

    def _at(self, pose_a: Array, pose_b: Array) -> tuple[Any, Any]:
        a, b = self._placed
        a.setRotation(pose_a[:3, :3])
        a.setTranslation(pose_a[:3, 3])
        b.setRotation(pose_b[:3, :3])
        b.setTranslation(pose_b[:3, 3])
        return a, b


def fcl_distances(body_a: Body, poses_a: ArrayLike, body_b: Body, poses_b: ArrayLike) -> FclAnswers:
    """Return FCL's signed distances of body_a and body_b [m]; as exact as FCL is.

    poses_a and poses_b: N poses (N, 4, 4) each, world from body. For unions, as ``signed_distance``, the result of the
    pair of pieces with the least distance; none where FCL crashed for any pair.

    The distances are computed in another process, which forks workers, each of which continues after the pose that
    crashed the one before (so it needs os.fork: Linux, macOS).

    Raises InputError on Windows, if python-fcl is not installed, for poses of another shape, not finite or not rigid,
    and for lists of unequal length; RuntimeError if the process fails in any other way.
    """
    _library()
    if sys.platform == "win32":
        raise InputError("FCL's distances need os.fork, which Windows lacks: FCL crashes its process for some bodies")
    pairs = pairs_of(body_a, body_b)
    world_a, world_b = check_pose_lists(poses_a, poses_b)
    every = [_of_pair(a, world_a, b, world_b) for a, b in pairs]
    nearest = np.argmin([each.distances for each in every], axis=0)  # the first NaN, where there is one
    rows = np.arange(len(world_a))
    return FclAnswers(*(np.stack([getattr(each, f.name) for each in every])[nearest, rows] for f in fields(FclAnswers)))


def _of_pair(body_a: ConvexBody, world_a: Array, body_b: ConvexBody, world_b: Array) -> FclAnswers:
    """Return FCL's answers for two convex bodies, from another process."""
    answers = np.zeros(len(world_a), ANSWER)
    for name in ("distance", "point_a", "point_b"):
        answers[name] = np.nan
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "task").write_bytes(pickle.dumps((body_a, world_a, body_b, world_b)))
        np.save(Path(folder, "answers.npy"), answers)
        one_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # a process with threads must not fork
        command = [sys.executable, "-P", "-c", CHILD, folder]
        child = subprocess.run(
            command, env=os.environ | one_thread, capture_output=True, text=True, check=False,
            start_new_session=True,  # only the caller receives Ctrl-C: it may want to keep what it has
        )  # fmt: skip
        if child.returncode != 0:
            raise RuntimeError(f"FCL's process ended with {child.returncode}: {child.stderr.strip()}")
        answers = np.load(Path(folder, "answers.npy"))
    from_b = answers["point_a"] - answers["point_b"]
    with np.errstate(invalid="ignore"):  # 0/0 where the points coincide
        normals = from_b * np.sign(answers["distance"])[:, None] / np.linalg.norm(from_b, axis=1, keepdims=True)
    return FclAnswers(
        answers["distance"] - (body_a.radius + body_b.radius),
        answers["point_a"] - body_a.radius * normals if body_a.radius else answers["point_a"],
        answers["point_b"] + body_b.radius * normals if body_b.radius else answers["point_b"],
        normals,
        ~answers["done"],
    )


def _answer_all(folder: str) -> None:
    """Answer the task in ``folder``; every pose without an answer at the end crashed a worker."""
    if sys.platform == "win32":
        raise OSError("no os.fork")
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # no core dump for each crash
    task = pickle.loads(Path(folder, "task").read_bytes())
    answers = np.load(Path(folder, "answers.npy"), mmap_mode="r+")  # what a worker wrote survives it
    start = 0
    while start < len(answers):
        worker = os.fork()
        if worker == 0:
            _work(task, answers, start)
        code = os.waitstatus_to_exitcode(os.waitpid(worker, 0)[1])
        if code == 0:
            return
        if -code not in CRASH_SIGNALS:
            sys.exit(f"a worker ended with {code}")
        start += int(np.argmin(answers["done"][start:])) + 1


def _work(task: tuple[ConvexBody, Array, ConvexBody, Array], answers: NDArray[np.void], start: int) -> None:
    """Answer the poses from ``start`` on, and end this process."""
    code = 1
    try:
        body_a, poses_a, body_b, poses_b = task
        pair = FclPair(body_a, body_b)
        for k in range(start, len(answers)):
            distance, point_a, point_b = pair.polytopes(poses_a[k], poses_b[k])
            answers[k] = True, distance, point_a, point_b
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def _shape(body: ConvexBody) -> Any:
    corners = triangles(body)
    faces = np.column_stack([np.full(len(corners), 3), corners])  # FCL wants the number of corners before them
    return _library().Convex(body.vertices, len(corners), faces.ravel())


def _library() -> Any:
    try:
        import fcl
    except ImportError:
        raise InputError("needs python-fcl, which is not installed: pip install python-fcl") from None
    return fcl
