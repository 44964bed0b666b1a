"""A child of test_recipes: follows the recipes of docs/contributing.md in a copy of the tree, step by step.

Argument: the copy's folder. Standard output: JSON list of [recipe, files touched so far, probe, what came of it].
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import io
import itertools
import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

TREE = Path(sys.argv[1])
sys.path.insert(0, str(TREE / "src"))
Edit = tuple[str, str, str]  # file, before which text, what is inserted; at the end of a new file without the second

CHECK = '''"""The rate of torque, by differences of samples: enough for a recipe."""
import numpy as np
import pinocchio as pin
from hdplan.planner.certificate.limit_checks import LimitFinding, Use
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.robot.loads import loads_in

class TorqueRateCheck:
    def __init__(self, setup):
        self.limits = {"torque_rate": setup.limits["torque_rate"]}
        self.model, self.robot = setup.loaded_model, setup.robot
        self.loads = loads_in(self.model, setup.scene, setup.robot)

    def check(self, curve):
        width, steps = float(curve.widths.sum()), np.linspace(0.0, 1.0, 501)
        torques = self.values("torque", curve, *curve.interval_of(steps))
        limit = float(self.limits["torque_rate"][0])
        share = float(np.abs(np.diff(torques, axis=0)).max() / (width / 500) / limit)
        use = Use("torque_rate", share, self.robot.joint_names[0], 0, limit)
        wrong = () if use.within else ((Status.OVERLOADED, f"torque_rate up to {share:.1%} of its limit"),)
        return LimitFinding((use,), wrong, loads=self.loads)

    def values(self, quantity, curve, interval, fraction):
        rows = zip(*(curve.over_time(order).at(interval, fraction) for order in range(3)))
        data = self.model.createData()
        return np.array([pin.rnea(self.model, data, self.robot.pin_q(q), v, a) for q, v, a in rows])

    def overload(self, q):
        return None
'''
LAW = '''"""What keeps the rate of torque: nothing but time."""
import numpy as np

class TorqueRateLimit:
    def __init__(self, setup):
        self.setup = setup

    def rows(self, spline):
        return None

    def stretch(self, curve):
        from hdplan.planner.certificate.torque_rate_check import TorqueRateCheck

        return TorqueRateCheck(self.setup).check(curve).uses[0].share
'''
SHAPE = '''@dataclass(frozen=True, repr=False)
class Octahedron(Solid):
    """An octahedron with half axes `radii` [m] along x, y and z."""

    radii: Annotated[Vector3, Row(Number(above=0.0, unit="m"), 3)]


'''
ROW = """    Octahedron: Operations(
        fields="radii",
        words=lambda shape: "octahedron",
        coal=lambda shape, _: convex_hull(_corners(shape)),
        inertia=lambda shape, mass, _: _even(trimesh.convex.convex_hull(_corners(shape)), mass),
        triangles=lambda shape: trimesh.PointCloud(_corners(shape)).convex_hull,
        outline=Outline(
            half_size=lambda shape: np.array(shape.radii),
            support=lambda shape, n: np.abs(n * shape.radii).max(axis=1),
            around=lambda shape: _corners(shape),
            round_about="nothing",
            swept=lambda shape: Swept(_corners(shape)),
        ),
        sizes="radii",
    ),
"""
CORNERS = """def _corners(shape):
    return np.concatenate([np.diag(shape.radii), -np.diag(shape.radii)])


"""
SOLVER = '''"""Nothing is improved."""
from hdplan.planner.solvers.solution import Progress, Solver

def solve(problem, guess, budget):
    return Progress(problem, budget, 1).solution(problem.clip(guess))

'''
WORDS = '''"""One line for each waypoint."""
import numpy as np
from hdplan.scenes.errors import InputError

def write_words(trajectory, verdict):
    if trajectory.times is not None:
        raise InputError("no times: write .json")
    rows = [" ".join(map(repr, row)) for row in trajectory.positions.tolist()]
    return "\\n".join([" ".join(trajectory.joint_names), *rows]).encode()

def read_words(data):
    names, *rows = data.decode().splitlines()
    values = np.array([[float(value) for value in row.split()] for row in rows])
    return {"joint_names": tuple(names.split()), "positions": values}
'''
LENGTH = '''class Length(Objective):
    """The length of the path."""

    name, unit = "length", "rad"

    def value(self, path: Array, motion: Trajectory) -> float:
        return self.least_along(path)

    def least_along(self, path: Array) -> float:
        return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())

    def least(self, problem: Problem) -> float:
        return float(np.linalg.norm(problem.goal - problem.start))


'''
CHAIN = '''"""A robot of equal links in a row, each turned about z."""
from xml.etree.ElementTree import Element, fromstring
from hdplan.scenes.robot_files.mjcf import Converted

def chain(root, path):
    count = int(root.get("links"))
    links = "".join(f"<link name='l{i}'/>" for i in range(count + 1))
    limit = "<axis xyz='0 0 1'/><limit lower='-1' upper='1' velocity='1' effort='1'/>"
    joints = "".join(
        f"<joint name='j{i}' type='revolute'><parent link='l{i}'/><child link='l{i + 1}'/>"
        f"<origin xyz='{0.1 * bool(i)} 0 0'/>{limit}</joint>"
        for i in range(count)
    )
    return Converted(fromstring(f"<robot name='chain'>{links}{joints}</robot>"), notes=("a chain",))
'''
BALL = '''class Ball:
    """A ball at the origin of the world."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server, self._node = server, None

    def show(self, on: bool) -> None:
        if on and self._node is None:
            self._node = self._server.scene.add_icosphere("/ball_of_a_recipe", 0.1)
        if self._node is not None:
            self._node.visible = on


'''
UNION = "Shape = Box | Sphere | Ellipsoid | Cylinder | Capsule | Points | Mesh\n"
LIMIT = "planner/certificate/limit_checks.py"
RECIPES: dict[str, list[Edit]] = {
    "A limit": [
        (
            "scenes/limits.py",
            '    "torque": JointQuantity(',
            '    "torque_rate": JointQuantity("torque_rate", "Nm/s or N/s"),\n',
        ),
        (
            "scenes/limits.py",
            '    torque: Annotated[JointValues | None, QUANTITIES["torque"]]',
            '    torque_rate: Annotated[JointValues | None, QUANTITIES["torque_rate"]] = None\n',
        ),
        ("planner/certificate/torque_rate_check.py", "", CHECK),
        (
            LIMIT,
            '    if "torque" in setup.limits:\n',
            '    if "torque_rate" in setup.limits:\n'
            "        from hdplan.planner.certificate.torque_rate_check import TorqueRateCheck\n\n"
            "        yield TorqueRateCheck(setup)\n",
        ),
        ("planner/timing/torque_rate_limit.py", "", LAW),
        (
            "planner/timing/limits.py",
            '        case "torque":\n',
            '        case "torque_rate":\n'
            "            from hdplan.planner.timing.torque_rate_limit import TorqueRateLimit\n\n"
            "            return TorqueRateLimit(setup)\n",
        ),
    ],
    "A shape": [
        ("scenes/shapes.py", UNION, SHAPE),
        ("scenes/shapes.py", "\n\ndef own_fields(", "Shape = Shape | Octahedron\n"),
        (
            "planner/geometry/shape_table.py",
            "from hdplan.scenes.shapes import ",
            "from hdplan.scenes.shapes import Octahedron\n",
        ),
        ("planner/geometry/shape_table.py", "TABLE: dict", CORNERS),
        ("planner/geometry/shape_table.py", "    Points: Operations(", ROW),
        (
            "planner/certificate/exact_proximity.py",
            "from hdplan.scenes.shapes import ",
            "from hdplan.scenes.shapes import Octahedron\n",
        ),
        (
            "planner/certificate/exact_proximity.py",
            "    Points: lambda points",
            "    Octahedron: lambda radii: (hull_piece(np.concatenate([np.diag(radii), -np.diag(radii)])),),\n",
        ),
    ],
    "A trajectory file": [
        ("planner/motion/words_format.py", "", WORDS),
        (
            "planner/motion/trajectory_files.py",
            "from hdplan.planner.motion.json_format",
            "from hdplan.planner.motion.words_format import read_words, write_words\n",
        ),
        ("planner/motion/trajectory_files.py", '    ".json": write_json,\n', '    ".words": write_words,\n'),
        ("planner/motion/trajectory_files.py", '    ".json": read_json,\n', '    ".words": read_words,\n'),
    ],
    "An objective": [
        ("scenes/planner_settings.py", 'LINK_BODIES = ("fitted"', 'OBJECTIVES = (*OBJECTIVES, "length")\n'),
        ("planner/search/objective.py", "class Smoothness(Objective)", LENGTH),
        (
            "planner/search/objective.py",
            '        case "energy":\n',
            '        case "length":\n            return Length()\n',
        ),
    ],
    "A language of robots": [
        ("scenes/robot_files/chain.py", "", CHAIN),
        (
            "scenes/robot_files/urdf_text.py",
            "from hdplan.scenes.robot_files.mjcf ",
            "from hdplan.scenes.robot_files.chain import chain\n",
        ),
        ("scenes/robot_files/urdf_text.py", '    "mujoco": as_urdf,\n', '    "chain": chain,\n'),
    ],
    "A layer of the viewer": [
        ("planner/view/marks.py", "class Trail:", BALL),
        (
            "planner/view/layers.py",
            "from hdplan.planner.view.marks import ",
            "from hdplan.planner.view.marks import Ball\n",
        ),
        ("planner/view/layers.py", "    NAMES: (False, ", '    "ball": (False, "at the origin"),\n'),
        (
            "planner/view/layers.py",
            "        self.plane, self.boxes = PlaneLayer",
            "        self.ball = Ball(viewer.server)\n",
        ),
        (
            "planner/view/layers.py",
            "        self.boxes.show(self.on(BOXES))",
            '        self.ball.show(self.on("ball"))\n',
        ),
    ],
    "A solver": [
        ("planner/solvers/methods/straight.py", "", SOLVER),
        ("planner/solvers/methods/straight.py", "", "SOLVER = Solver(solve)\n"),
    ],
    "A command": [
        ("planner/commands/hello.py", "", '"""Greets."""\n\ndef hello():\n    print("hello")\n    return 0\n'),
        ("cli.py", "def _version(", '@command(app, "hello.hello")\ndef hello() -> None:\n    """Greet."""\n\n\n'),
    ],
}


def apply(edits: Iterable[Edit]) -> None:
    for file, before, new in edits:
        path = TREE / file
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        assert text.count(before) == 1 or not before, (file, before)
        path.write_text(text.replace(before, new + before) if before else text + new, encoding="utf-8")


def fresh() -> None:
    """Forget hdplan, so that it is imported as it stands now."""
    for name in [name for name in sys.modules if name.split(".")[0] == "hdplan"]:
        del sys.modules[name]
    importlib.invalidate_caches()
    assert str(TREE) in str(importlib.import_module("hdplan").__file__)


def came_of(run: Callable[[], str]) -> str:
    try:
        return run()
    except Exception as error:
        return f"{type(error).__name__}: {error}"


# --- what is tried after each step ------------------------------------------------------------------------------------


def part(module: str) -> Any:
    return importlib.import_module(f"hdplan.{module}")


def timed(**limits: float) -> Any:
    module = importlib.import_module("hdplan")
    scene = module.load_scene("planar_arm")
    kept = part("scenes.limits").Limits(acceleration=2.0, **limits)
    settings = part("scenes.planner_settings").PlannerSettings(polish=0)
    return module.Scene(robot=scene.robot, start=scene.start, goal=scene.goal, limits=kept, planner=settings)


def motion() -> Any:
    return importlib.import_module("hdplan").Trajectory.load(TREE / "motion.json")


def certified(**limits: float) -> str:
    return str(importlib.import_module("hdplan").certify(timed(**limits), motion()).text)


def planned(scene: Any, solver: str = "gauss_newton") -> str:
    return str(importlib.import_module("hdplan").plan(scene, solver=solver).certificate.text)


def followed() -> str:
    """Consequences without a step of their own: files, words, replay and its sheet, and that no proof claims it."""
    module, scene, place = importlib.import_module("hdplan"), timed(torque_rate=1e5), TREE / "scene.yaml"
    scene.save(place)
    assert module.load_scene(place).limits == scene.limits
    effects = part("planner.terminal.explain_effects").effects(module.build(scene))
    assert "limits of torque_rate" in {effect.name for effect in effects if effect.on}
    simulation = part("planner.control.simulation").replay(part("planner.robot.setup").Setup.of(scene), motion())
    drawn = part("planner.pictures.simulation_sheet").simulation_sheet(simulation, "")
    titles = [axis.get_title("left") for axis in drawn.axes]
    assert "torque_rate" in titles, titles
    return str(module.prove(place, TREE / "motion.json").text)


def around() -> str:
    module = importlib.import_module("hdplan")
    scene = module.load_scene("planar_arm")
    made = part("scenes.shapes").Octahedron([0.1, 0.12, 0.1], pose=[0.9, 0.05, 0.1])
    return planned(module.Scene(robot=scene.robot, obstacles=[made], start=scene.start, goal=scene.goal))


def written() -> str:
    """The planned motion, written and read again without its times, and its verdict; with times it is refused."""
    module, whole = importlib.import_module("hdplan"), motion()
    bare = module.Trajectory(whole.joint_names, whole.positions)
    bare.save(TREE / "motion.words")
    again = module.Trajectory.load(TREE / "motion.words")
    assert (again.joint_names, again.positions.tolist()) == (bare.joint_names, bare.positions.tolist())
    message = came_of(lambda: str(whole.save(TREE / "timed.words")))
    assert not (TREE / "timed.words").exists()
    return message


def by_length() -> str:
    """The plan of a scene's file with this objective, and what its motion achieves."""
    settings = part("scenes.planner_settings").PlannerSettings(polish=0, objective="length")
    scene = dataclasses.replace(timed(), planner=settings)
    found = importlib.import_module("hdplan").plan(scene)
    rows = found.trajectory.positions
    achieved = found.objective
    assert achieved.value >= 0.999 * float(((rows[-1] - rows[0]) ** 2).sum() ** 0.5)
    return f"{achieved.name} [{achieved.unit}]: {found.certificate.text}"


def chained() -> str:
    """A robot in the new language: planned, and shown with its note."""
    (TREE / "arm.xml").write_text("<chain links='2'/>", encoding="utf-8")
    module = importlib.import_module("hdplan")
    scene = module.Scene(robot=module.RobotSpec(urdf=TREE / "arm.xml"), start=[0.0, 0.0], goal=[0.5, 0.5])
    assert "a chain" in module.load_robot(scene.robot).notes
    return planned(scene)


def layered() -> str:
    """The nodes that the layer's box shows, and hides again."""
    front = part("planner.view.server").open_viewer(timed(), [], port=8280, complain=print)
    try:
        layers, nodes = front.panel.layers, front.server.scene._handle_from_node_name
        seen = []
        for on in (True, False):
            layers.set("ball", on)
            front.worker.settle(30.0)
            layers._switch()
            seen.append("/ball_of_a_recipe" in nodes and nodes["/ball_of_a_recipe"].visible)
        return f"seen: {seen}; hint: {part('planner.view.layers').LAYERS['ball'][1]}"
    finally:
        front.close()


def greeted() -> str:
    output, sys.argv = io.StringIO(), ["hdplan", "hello"]
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        try:
            part("cli").main()
        except SystemExit as end:
            return f"{end.code}: {output.getvalue().strip()}"
    return output.getvalue()


PROBES: dict[str, dict[str, Callable[[], str]]] = {  # the checks after each step, or at last
    "A limit": {
        "at last": followed,
        "certify": lambda: certified(torque_rate=1e5),
        "certify tightly": lambda: certified(torque_rate=1e-3),
        "plan": lambda: planned(timed(torque_rate=1e5)),
    },
    "A shape": {"plan": around},
    "A trajectory file": {"save": written},
    "An objective": {"plan": by_length},
    "A language of robots": {"plan": chained},
    "A layer of the viewer": {"switch": layered},
    "A solver": {"plan": lambda: planned(timed(), "straight")},
    "A command": {"run": greeted},
}


def tried(recipe: str, done: list[str]) -> list[list[Any]]:
    fresh()
    last = set(done) == {file for file, *_ in RECIPES[recipe]}
    probes = {name: probe for name, probe in PROBES[recipe].items() if last or name != "at last"}
    return [[recipe, done[:], name, came_of(probe)] for name, probe in probes.items()]


def main() -> None:
    fresh()
    importlib.import_module("hdplan").plan(timed()).trajectory.save(TREE / "motion.json")
    found: list[Any] = []
    for recipe, steps in RECIPES.items():
        done: list[str] = []
        before = {}
        for file, edits in itertools.groupby(steps, key=lambda edit: edit[0]):
            before[file] = (TREE / file).read_text(encoding="utf-8") if (TREE / file).exists() else ""
            apply(edits)
            done.append(file)
            found += tried(recipe, done)
        for file in [file for file in done[1:-1] if before[file]]:  # all steps but one in the middle
            whole = (TREE / file).read_text(encoding="utf-8")
            (TREE / file).write_text(before[file], encoding="utf-8")
            found += tried(recipe, [other for other in done if other != file])
            (TREE / file).write_text(whole, encoding="utf-8")
    print(json.dumps(found))


main()
