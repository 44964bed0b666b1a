"""A certified motion → its proof: a file that `hdplan.verify` checks without hdplan (docs/proof.md).

The certificate says what can be proven; here the planes are found that prove nearly as much (ALLOWED_LOSSES) by the
checker's own bound. A mesh whose hull is too close is divided into groups of triangles, finer where that is needed.
"""

from __future__ import annotations

import contextlib
import json
import time
import zlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.proof.meshes import divided, groups_of
from hdplan.planner.proof.planes import Obstruction, Planes
from hdplan.planner.proof.rays import rays
from hdplan.planner.proof.world import world_of
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError, NotProvenError, naming
from hdplan.scenes.output import write_output
from hdplan.scenes.scene import Scene, unknown_in
from hdplan.scenes.values import FilePath, checked, path_of
from hdplan.scenes.yaml_format.reader import find_scene, load_scene
from hdplan.verify import RejectedError
from hdplan.verify.balls import need
from hdplan.verify.checking import verdict_of
from hdplan.verify.compare import check_equal, digest, plain, triangles
from hdplan.verify.effects import check_claim, wanted
from hdplan.verify.kernel import MAGIC, VERSION, check_apart, least_distances, unpack
from hdplan.verify.reading import Reading, read_world
from hdplan.verify.world import Piece, World

# [m] by which a proof may fall short of the certificate's clearance: the larger ones only where sizes are unknown.
ALLOWED_LOSSES = (1e-4, 5e-4, 2e-3)
COMPRESSION = 1  # level of compression: a tenth larger than by the usual one, in a fifth of the time
MOST_ROUNDS = 40  # in which meshes are divided


@dataclass(frozen=True)
class Proof:
    """A proof that a motion is free, as `hdplan.verify` reads it."""

    data: bytes  # the file's content
    text: str  # what is proven, in the checker's words
    certificate: Certificate  # the certificate that it proves
    leaves: int  # number of leaves of all pairs
    checking: float  # [s] of the processor that the checker took: its own reading of the files, the world that it makes
    # of it, and the check of what was written

    def save(self, path: FilePath) -> None:
        """Write the file, whole or not at all. Raises InputError for a path that cannot be written."""
        write_output(checked(path_of, path, "path"), self.data)


def prove(
    scene: FilePath, trajectory: FilePath, request: FilePath | None = None, robot: FilePath | None = None
) -> Proof:
    """Certify a motion and return the proof that it is free.

    A proof refers to files: `scene` is a hdplan scene, or a shipped one's name, `trajectory` a JSON or CSV file. A
    MoveIt planning scene needs its motion plan `request` and the `robot`, as in `load_scene`: its name, its
    description, or a YAML file with a `robot` section.

    Raises:
        InputError: for bad files, and, by name, for contents that a proof cannot hold yet.
        NotProvenError: the motion is not certified, or no planes were found.
    """
    files = _Files.of(scene, trajectory, request, robot)
    setup = Setup.of(load_scene(files.scene, files.request, files.robot))
    motion = Trajectory.load(files.motion)
    with naming(files.motion):
        certificate = certified(setup, motion)
    return files.proof(setup, motion, certificate)


class Planned(Protocol):
    """The part of a plan that a proof uses (`PlanResult`)."""

    @property
    def requested(self) -> Scene | None:
        """The scene of the plan."""

    @property
    def trajectory(self) -> Trajectory:
        """The motion."""

    @property
    def certificate(self) -> Certificate:
        """The proven statement."""


def prove_planned(
    result: Planned,
    scene: FilePath,
    trajectory: FilePath,
    request: FilePath | None = None,
    robot: FilePath | None = None,
) -> Proof:
    """Write down why a motion is free that was planned in this process, in a scene read from these files, and written
    to the file `trajectory`: hdplan neither reads nor certifies it again. The checker reads the files, and there is no
    proof if they have other numbers by now. Raises as `prove`."""
    files = _Files.of(scene, trajectory, request, robot)
    assert result.requested is not None
    return files.proof(Setup.of(result.requested), result.trajectory, result.certificate)


@dataclass(frozen=True)
class _Files:
    """The subject of a proof."""

    scene: Path
    motion: Path
    request: Path | None
    robot: str | None

    @classmethod
    def of(cls, scene: FilePath, trajectory: FilePath, request: FilePath | None, robot: FilePath | None) -> _Files:
        """Check that these are names of files. Raises InputError."""
        return cls(
            find_scene(scene),
            checked(path_of, trajectory, "trajectory"),
            None if request is None else checked(path_of, request, "request"),
            None if robot is None else str(checked(path_of, robot, "robot")),
        )

    def proof(self, setup: Setup, motion: Trajectory, certificate: Certificate) -> Proof:
        """Return the proof of a motion with this certificate, once the checker reads of these files what the setup has.
        Raises InputError and NotProvenError."""
        planned = world_of(setup, motion)
        with writing():
            began = time.process_time()
            reading = read_world(self.scene, self.motion, planned, self.request, self.robot)
            check_equal(reading.world, planned)
            return proof_of(setup, planned, reading, certificate, time.process_time() - began)


@contextlib.contextmanager
def writing() -> Iterator[None]:
    """Say that no proof can be written of what the checker rejects, and why."""
    try:
        yield
    except RejectedError as error:
        raise InputError(f"no proof of this can be written: {error}") from None


def certified(
    setup: Setup, motion: Trajectory, known: Certificate | None = None, passing: Collection[str] = ()
) -> Certificate:
    """Return the certificate of a motion, which may be known; `passing` as in `Certifier.certify`. Raises
    NotProvenError."""
    certificate = known or Certifier(setup).certify(motion, passing=passing)
    if not certificate.certified:
        raise NotProvenError(certificate.text)
    return certificate


def proof_of(
    setup: Setup, planned: dict[str, Any], reading: Reading, certificate: Certificate, took: float = 0.0
) -> Proof:
    """Return the proof of a motion in the world of the checker's `reading`, which is that in which it was `planned`,
    and `took` so much processor time [s]. Raises NotProvenError and RejectedError."""
    return _Writer(setup, planned, reading, took).write(certificate)


class _Writer:
    """The proof of one motion in the making."""

    def __init__(self, setup: Setup, planned: dict[str, Any], reading: Reading, took: float) -> None:
        self.setup, self.planned, self.reading, self.took = setup, planned, reading, took
        self.cuts: dict[str, Any] = {
            str(number): cells
            for number, body in enumerate(reading.world["bodies"])
            if (cells := groups_of(body["shape"])) is not None
        }
        self.known = dict[Any, tuple[Rows, Array]]()  # depths and normals by pieces

    def write(self, certificate: Certificate) -> Proof:
        *more, last = ALLOWED_LOSSES if any(unknown_in(self.setup.scene)) else ALLOWED_LOSSES[:1]
        for short in more:  # the checker's own bounds on what is unknown are a little larger
            with contextlib.suppress(NotProvenError):
                return self._written(certificate, short)
        return self._written(certificate, last)

    def _written(self, certificate: Certificate, short: float) -> Proof:
        least, required, bound = self.setup.scene.self_collision.clearance, certificate.required, certificate.clearance
        # less than the scene's only where the ends keep less, not where the caller requires less
        lower = bound is not None and bound < required == self.setup.scene.planner.clearance
        clearance = _less(bound, 0.0 if lower else required, short)
        own = _less(certificate.self_clearance, least, short)
        for _ in range(MOST_ROUNDS):
            began = time.process_time()
            world = World(self.reading.world, self.cuts)
            self.took += time.process_time() - began
            claimed = {
                "clearance": None if world.within.all() else clearance,
                "self_clearance": own if world.within.any() else None,
                "claims": ["clearance"] * lower,
            }
            lost = self._separate(world, least_distances(world, claimed))
            if not lost:
                return self._pack(world, claimed, certificate)
            self._divide(world, lost)
        raise NotProvenError(f"no planes were found within {MOST_ROUNDS} divisions of meshes")

    def _separate(self, world: World, floor: Array) -> list[Obstruction]:
        """Find planes for the pairs of pieces that are new, and return those for which there are none."""
        keys = [_identity(piece) for piece in world.pieces]
        pairs = [(keys[a], keys[b]) for a, b in world.pairs.tolist()]
        planes = Planes(world)
        new = np.array([p for p, key in enumerate(pairs) if key not in self.known], dtype=np.int64)
        leaves, lost = planes.separate(new, floor)
        without = {each.pair for each in lost}
        ends = (np.searchsorted(leaves.pair, new, side=side).tolist() for side in ("left", "right"))
        for p, begin, end in zip(new.tolist(), *ends, strict=True):
            if p not in without:
                self.known[pairs[p]] = leaves.depth[begin:end], leaves.normal[begin:end]
        self.found = [self.known.get(key) for key in pairs]
        return lost

    def _divide(self, world: World, lost: list[Obstruction]) -> None:
        """Divide the groups of triangles that are too close to something. Raises NotProvenError where nothing can be
        divided."""
        finer = {i: self._finer(world, i) for i in {i for each in lost for i in world.pairs[each.pair].tolist()}}
        for each in lost:
            a, b = world.pairs[each.pair].tolist()
            if not finer[a] and not finer[b]:
                raise NotProvenError(
                    f"no plane keeps {world.pieces[a].key} and {world.pieces[b].key} apart after waypoint "
                    f"{int(each.row)}: their hulls are {each.distance * 1e3:.3g} mm apart"
                )

    def _finer(self, world: World, piece: int) -> bool:
        """Divide the triangles of a piece, if it has several."""
        body = world.pieces[piece].body
        key = str(body)
        if key not in world.parts:
            return False
        points = np.asarray(self.reading.world["bodies"][body]["shape"]["points"])
        triangles = points[world.parts[key]]  # or boxes, or the centres of balls
        groups = self.cuts.get(key, np.zeros(len(triangles), dtype=np.int64))
        own = [i for i, each in enumerate(world.pieces) if each.body == body]  # in the order of the groups
        finer = divided(groups, own.index(piece), triangles)
        self.cuts.update({} if finer is None else {key: finer})
        return finer is not None

    def _pack(self, world: World, claimed: dict[str, Any], certificate: Certificate) -> Proof:
        """Return the file, once the checker accepts it."""
        missing = list[tuple[int, Array]]()  # of the meshes
        names = {piece.body: piece.key for piece in world.pieces}
        for (mesh, pieces), found in zip(world.outside, rays(world), strict=True):
            if found is None:
                raise NotProvenError(f"{pieces[0].key} may lie within {names[mesh]}: no ray from it misses the mesh")
            missing.append(found)
        depths = [each[0] for each in self.found if each is not None]
        normals = [each[1] for each in self.found if each is not None]
        head: dict[str, Any] = {
            "version": VERSION,
            "files": self.reading.hashes,
            **claimed,
            "cuts": {key: len(groups) for key, groups in self.cuts.items()},
            "pairs": len(depths),
            "leaves": sum(map(len, depths)),
            "rays": len(missing),
        }
        for claim in wanted(world):
            with contextlib.suppress(RejectedError):
                check_claim(world, claim)
                head["claims"] = [*head["claims"], claim]
        parts = (
            *((groups, "<u2") for groups in self.cuts.values()),
            (np.array([len(each) for each in depths]), "<u4"),
            (np.concatenate([*depths, np.zeros(0)]), "<u1"),
            (np.concatenate([*normals, np.zeros((0, 3))]), "<i4"),
            (np.array([row for row, _ in missing]), "<u4"),
            (np.array([way for _, way in missing]), "<i4"),
        )
        written = (head, self._planned_world())
        lines = [json.dumps(each, allow_nan=False, separators=(",", ":"), default=plain) for each in written]
        content = "".join(f"{line}\n" for line in lines).encode()
        data = MAGIC + zlib.compress(content + b"".join(x.astype(kind).tobytes() for x, kind in parts), COMPRESSION)
        began = time.process_time()
        read, text, _, trees = unpack(data)
        need(text == lines[1].encode(), "the written file differs from the proof")
        check_apart(world, read, trees)  # what was written, in the world that was read already
        took = self.took + time.process_time() - began
        return Proof(data, verdict_of(world, read, self.reading).text, certificate, head["leaves"], took)

    def _planned_world(self) -> dict[str, Any]:
        """Return the world in which hdplan planned, with the digest alone of each mesh that the checker reads itself,
        to the same bits, and of the balls that it reads itself, which are hdplan's but for rounding: with the rows of
        those that are left out."""
        bodies, left_out = [], self.reading.left_out
        for body, other in zip(self.planned["bodies"], self.reading.world["bodies"], strict=True):
            own, read = body["shape"], other["shape"]
            if body["kind"] == "obstacle" and body["name"] in left_out:
                bodies.append({**body, "shape": {**digest(read), "left_out": left_out[body["name"]]}})
                continue
            taken = own is read or own.get("points") is read.get("points")  # from hdplan's world, not from a file
            same = triangles(own) and triangles(read) and not taken
            same = same and all(np.array_equal(own[key], read[key]) for key in ("points", "parts"))
            bodies.append({**body, "shape": digest(own)} if same else body)
        return {**self.planned, "bodies": bodies}


def _less(clearance: float | None, required: float, short: float) -> float:
    """Return the clearance [m] to prove: nearly the certificate's, but not less than required."""
    if clearance is None:
        return short
    return max(required, clearance - min(0.9 * short, 0.5 * clearance))


def _identity(piece: Piece) -> tuple[int, bytes]:
    """Key of a piece, equal in another division of its mesh."""
    return piece.body, piece.corners.tobytes()
