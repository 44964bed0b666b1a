"""Robots' files, generated in odd but legal syntax or made wrong: URDF, SRDF and xacro with packages.

Judged by urdfdom and Pinocchio on the file, apart from its visuals (Assimp reads its meshes; xacro runs in a process of
its own): the same joints, limits, geometry and placements at random configurations, the same pairs and states of the
SRDF; or refused. What hdplan reads and the judge reads otherwise is a finding.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_spec import RobotSpec
from sieges import meshes, mutations
from sieges.campaign import Outcome

Rng = np.random.Generator

CLOSE = 1e-7  # [m, rad] by which two readers of one text may differ; OBJ files are read in single precision by Assimp
SINGLE = 1e-5
UNLIMITED = 1e6  # [rad] or [m] a limit that stands for none
TRIED = 3  # configurations
HEAD = "import sys; from xacro import main; sys.path.insert(0, {!r}); sys.argv = ['xacro', *{!r}]; main()"
FIND = "def get_package_share_directory(name):\n    return {{{!r}: {!r}}}[name]\n"
VENDORS = (
    "<gazebo reference='l0'><material>Gazebo/Red</material></gazebo>",
    "<transmission name='t'><type>x</type></transmission>",
    "<v:thing xmlns:v='urn:v' size='1'/>",
    "<!-- <link name='ghost'/> -->",
    "<?editor fold?>",
    "<material name='red'><color rgba='1 0 0 1'/></material>",
)
VISUALS = (
    "<visual><geometry><capsule radius='1' length='2'/></geometry></visual>",
    "<visual><geometry><mesh filename='package://none/gone.dae'/></geometry><material/></visual>",
    "<visual><geometry><box size='1 1'/></geometry></visual>",
    "<visual><geometry><sphere radius='1'/></geometry><material name='red'/></visual>",
)
WRONG = (  # what is put in place of a piece of the text, by a pattern
    (r"<origin ", "<origin xmlns='u' "),
    (r"<(origin|axis|limit|collision|geometry|mass) ?", r"<u:\1 xmlns:u='u' "),
    (r"(xyz|rpy|size|radius|length|lower|upper|scale)=", r"\1x="),
    (r"(xyz|rpy|size|radius|length|lower|upper|scale)=", r"u:\1="),
    (r"(<(?:origin|axis|limit|mass|inertia|box|sphere|mesh) [^<>]*/>)", r"\1\1"),
    (r"<(origin|axis|limit|mass|inertia|box|sphere|mesh) [^<>]*/>", ""),
    (r"<(collision|inertial|link|joint)\b", r"<\1s"),
    (r"type=(['\"])\w+", r"type=\1floating"),
    (r"(['\"])([-+]?\d)", r"\1\g<2>_0"),
    (r"</(link|joint|collision)>", r"3</\1>"),
    (r"(parent|child) link=(['\"])l", r"\1 link=\2k"),
    (r"<mass value=(['\"])", r"<mass value=\1-"),
    (r"<robot", "<!DOCTYPE robot [<!ATTLIST origin xyz CDATA '9 9 9'>]><robot"),
    (r"</robot>", "<loop_joint name='x'/></robot>"),
    (r"</robot>", "<link name='l0'/></robot>"),
)


def attack(rng: Rng, folder: Path) -> Outcome:
    """Write one robot, mostly with something odd or wrong in it, and compare what is read of it."""
    kind = str(rng.choice(["urdf", "srdf", "xacro"], p=[0.5, 0.25, 0.25]))
    text, srdf = _robot(rng, folder)
    spoilt = bool(rng.random() < 0.6)
    if spoilt and kind != "srdf":
        text = _wrong(rng, text)
    if spoilt and kind == "srdf":
        srdf = _wrong(rng, srdf)
    file, package = folder / "arm.urdf", folder / "ws" / "pkg"
    file.write_text(text)
    judged = file
    if kind == "srdf":
        (folder / "arm.srdf").write_text(srdf)
    if kind == "xacro":
        file, judged = _as_xacro(rng, package, text), folder / "expanded.urdf"
    try:
        robot = load_robot(RobotSpec(urdf=file, srdf=folder / "arm.srdf" if kind == "srdf" else None))
    except InputError as error:
        words = str(error)
        if "\n" in words or not words.startswith("robot"):
            return Outcome("words", f"refused without its field, or on several lines: {words[:200]}")
        return Outcome(f"{kind}: {'spoilt, ' * spoilt}refused", notes={"refused": words})
    if kind == "xacro" and not _expand(file, judged, package):
        return Outcome("xacro alone", f"{kind}: hdplan expands what xacro does not")
    try:
        model, geometry = _judge(judged)
    except (ValueError, RuntimeError, IndexError) as error:
        return Outcome(f"{kind}: refused by the judge alone", notes={"the judge refuses": str(error)[:200]})
    finding = _difference(rng, robot, model, geometry)
    if kind == "srdf" and not finding:
        finding = _difference_of_words(robot, model, geometry, folder / "arm.srdf")
    return Outcome(f"{kind}: {'spoilt, ' * spoilt}the same", f"{kind}: {finding}" if finding else "")


# --- files -----------------------------------------------------------------------------------------------


def _robot(rng: Rng, folder: Path) -> tuple[str, str]:
    """Return a random tree of links as URDF, and an SRDF for it; meshes lie beside it."""
    count = int(rng.integers(2, 6))
    parts, joints = [], []
    for i in range(count):
        bodies = "".join(_collision(rng, folder, f"m{i}_{k}") for k in range(int(rng.integers(0, 3))))
        inside = [bodies, *([_inertial(rng)] if rng.random() < 0.5 else [])]
        inside += [str(rng.choice(VISUALS))] if rng.random() < 0.3 else []
        rng.shuffle(inside)
        parts.append(f"<link {_attribute(rng, 'name', f'l{i}')}>{''.join(inside)}</link>")
    for i in range(1, count):
        kind = str(rng.choice(["revolute", "continuous", "prismatic", "fixed"], p=[0.5, 0.2, 0.2, 0.1]))
        kind = "revolute" if i == 1 else kind
        limit = f"<limit {_attributes(rng, lower='-1.5', upper=_number(rng, 1.0), effort='1', velocity='2')}/>"
        children = [f"<parent link='l{int(rng.integers(i))}'/>", f"<child link='l{i}'/>"]
        children += [f"<axis {_attribute(rng, 'xyz', _row(rng, 3))}/>"] if rng.random() < 0.8 else []
        children += [_origin(rng)] if rng.random() < 0.8 else []
        children += [limit] if kind not in ("continuous", "fixed") else []
        children += ["<dynamics damping='1' friction='0'/>"] if rng.random() < 0.2 else []
        rng.shuffle(children)
        joints.append(f"j{i}")
        parts.append(f"<joint {_attributes(rng, name=f'j{i}', type=kind)}>{''.join(children)}</joint>")
    parts += [str(each) for each in rng.choice(VENDORS, int(rng.integers(0, 3)), replace=False)]
    rng.shuffle(parts)
    head = '<?xml version="1.0"?>\n' if rng.random() < 0.5 else ""
    values = "".join(f"<joint name='{name}' value='{_number(rng, 0.5)}'/>" for name in joints)
    pairs = "".join(
        f"<disable_collisions link1='l{a}' link2='l{b}' reason='x'/>"
        for a, b in (rng.choice(count, 2, replace=False) for _ in range(3))
    )
    named = "".join(f"<joint name='{name}'/>" for name in joints)
    srdf = f"<robot name='arm'><group name='g'>{named}</group><group_state name='s' group='g'>{values}</group_state>"
    return f"{head}<robot name='arm'>\n{_gap(rng).join(parts)}\n</robot>\n", f"{srdf}{pairs}</robot>\n"


def _collision(rng: Rng, folder: Path, name: str) -> str:
    size = _number(rng, 0.1, positive=True)
    match int(rng.integers(4)):
        case 0:
            shape = f"<box {_attribute(rng, 'size', _row(rng, 3, positive=True))}/>"
        case 1:
            shape = f"<sphere {_attribute(rng, 'radius', size)}/>"
        case 2:
            shape = f"<cylinder {_attributes(rng, radius=size, length=_number(rng, 0.3, positive=True))}/>"
        case _:
            meshes.write(folder / f"{name}.obj", meshes.hostile("box", rng, 0.2))
            scale = f" {_attribute(rng, 'scale', _row(rng, 3))}" if rng.random() < 0.5 else ""
            shape = f"<mesh filename='{folder / name}.obj'{scale}/>"
    inside = [f"<geometry>{shape}</geometry>", *([_origin(rng)] if rng.random() < 0.7 else [])]
    rng.shuffle(inside)
    return f"<collision>{''.join(inside)}</collision>"


def _inertial(rng: Rng) -> str:
    moments = _attributes(rng, ixx="0.1", ixy="0", ixz="0", iyy="0.1", iyz="0", izz="0.1")
    return f"<inertial>{_origin(rng)}<mass {_attribute(rng, 'value', '1.5')}/><inertia {moments}/></inertial>"


def _origin(rng: Rng) -> str:
    kept = {key: _row(rng, 3) for key in ("xyz", "rpy") if rng.random() < 0.8}
    return f"<origin {_attributes(rng, **kept)}/>"


def _attributes(rng: Rng, **values: str) -> str:
    attributes = [_attribute(rng, key, value) for key, value in values.items()]
    rng.shuffle(attributes)
    return " ".join(attributes)


def _attribute(rng: Rng, name: str, value: str) -> str:
    """Return an attribute in one of XML's spellings."""
    quote = str(rng.choice(["'", '"']))
    if rng.random() < 0.1:
        value = re.sub(r"\d", lambda found: f"&#{ord(found.group())};" if rng.random() < 0.5 else found.group(), value)
    return f"{name}{' ' * int(rng.integers(2))}={quote}{value}{quote}"


def _row(rng: Rng, count: int, positive: bool = False) -> str:
    gap = str(rng.choice([" ", "  ", "\n", "\t"]))
    return gap.join(_number(rng, 0.5, positive) for _ in range(count))


def _number(rng: Rng, size: float, positive: bool = False) -> str:
    """Return a number in one of the spellings that all readers have."""
    value = size * float(rng.uniform(0.1, 1.0)) * (1.0 if positive else float(rng.choice([-1.0, 1.0])))
    form = str(rng.choice(["{!r}", "{:.6f}", "{:.9e}", "{:+.4f}", "{:.3E}", "plain"]))
    return f"{value:.4f}".replace("0.", ".", 1) if form == "plain" else form.format(value)


def _gap(rng: Rng) -> str:
    return str(rng.choice(["", "\n", "  \n\t", "<!-- - -->"]))


def _wrong(rng: Rng, text: str) -> str:
    """Return the text made wrong, or what could be wrong to a reader."""
    if rng.random() < 0.35:
        return mutations.of_text(rng, text)
    for _ in range(int(rng.choice([1, 1, 2]))):
        pattern, instead = WRONG[int(rng.integers(len(WRONG)))]
        found = list(re.finditer(pattern, text))
        if found:
            place = found[int(rng.integers(len(found)))]
            text = text[: place.start()] + place.expand(instead) + text[place.end() :]
    return text


def _as_xacro(rng: Rng, package: Path, text: str) -> Path:
    """Write the robot as xacro, its links in another file of a package, and a number as an argument."""
    (package / "urdf").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>pkg</name></package>")
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    size = _number(rng, 1.0, positive=True)
    changed = re.sub(r"value=(['\"])1\.5\1", 'value="${m * $(arg n)}"', text)
    include = f'<xacro:include filename="$(find pkg)/urdf/m.xacro"/><xacro:arg name="n" default="{size}"/>'
    file = package / "urdf" / "arm.xacro"
    file.write_text(changed.replace("<robot name='arm'>", f"<robot name='arm' {space}>{include}"))
    name = "ball" if rng.random() < 0.8 else "bal"
    ball = f"<collision><geometry><sphere radius='${{m}}'/></geometry></collision></link><joint name='jx' {_MOVES}"
    macro = f"<xacro:macro name='{name}'><link name='lx'>{ball}</joint></xacro:macro><xacro:{name}/>"
    (package / "urdf" / "m.xacro").write_text(
        f"<robot {space}><xacro:property name='m' value='{size}'/>{macro}</robot>"
    )
    return file


_MOVES = "type='prismatic'><parent link='l0'/><child link='lx'/><limit lower='0' upper='1' effort='1' velocity='1'/>"


def _expand(file: Path, expanded: Path, package: Path) -> bool:
    """Let xacro expand the file in a process of its own, whose ROS knows one package."""
    ros = expanded.parent / "ros" / "ament_index_python"
    ros.mkdir(parents=True)
    (ros / "__init__.py").touch()
    (ros / "packages.py").write_text(FIND.format("pkg", str(package)))
    command = HEAD.format(str(ros.parent), [str(file), "-o", str(expanded)])
    return subprocess.run([sys.executable, "-c", command], capture_output=True, check=False).returncode == 0


# --- the judge -------------------------------------------------------------------------------------------


def _judge(urdf: Path) -> tuple[Any, Any]:
    """Return urdfdom's and Pinocchio's robot, without the visuals, which they check and planning does not, and in the
    part of XML that they know: no processing instructions, and blanks for other white space in attributes."""
    text = re.sub(r"(?s)<\?.*?\?>", "", re.sub(r"\s", " ", urdf.read_text()))
    text = re.sub(r"<visual>.*?</visual>|<material[^<>]*>.*?</material>", "", text)
    model = pin.buildModelFromXML(text)
    return model, pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)


def _difference(rng: Rng, robot: Robot, model: Any, geometry: Any) -> str:
    """Return in what hdplan's robot is not the judge's; empty for nothing."""
    own, theirs = {*robot.joint_names, *robot.locked}, {*model.names} - {"universe"}
    if own != theirs:
        return f"joints {sorted(own)} and {sorted(theirs)}"
    for i, name in enumerate(robot.joint_names):
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 1:
            ends = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
        else:
            ends = -np.inf, np.inf
        ends = tuple(np.copysign(np.inf, end) if abs(end) >= UNLIMITED else end for end in ends)
        if not np.allclose((robot.lower[i], robot.upper[i]), ends, rtol=0, atol=CLOSE):
            return f"limits of {name}: {robot.lower[i]}, {robot.upper[i]} and {ends}"
    pairs = _pairs(robot, model, geometry)
    if len(pairs) != geometry.ngeoms or len(pairs) != robot.collision.ngeoms:
        return f"{robot.collision.ngeoms} geometries and {geometry.ngeoms}"
    for mine, other in pairs:
        one, two = _shape(robot.collision.geometryObjects[mine]), _shape(geometry.geometryObjects[other])
        if one.shape != two.shape or not np.allclose(one, two, rtol=SINGLE, atol=SINGLE):
            return f"shapes of {geometry.geometryObjects[other].name}: {one.tolist()[:9]} and {two.tolist()[:9]}"
    for q in robot.draw(rng, TRIED):
        values = {**dict(zip(robot.joint_names, q.tolist(), strict=True)), **robot.locked}
        whole = pin.neutral(model)
        for name, value in values.items():
            joint = model.joints[model.getJointId(name)]
            whole[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        ours, pinocchio = _placed(robot.model, robot.collision, robot.pin_q(q)), _placed(model, geometry, whole)
        for mine, other in pairs:
            if not np.allclose(ours[mine], pinocchio[other], rtol=0, atol=CLOSE):
                return f"place of {geometry.geometryObjects[other].name} at {values}"
    return ""


def _pairs(robot: Robot, model: Any, geometry: Any) -> list[tuple[int, int]]:
    """Return geometries of the two by their links and order."""
    there: dict[str, list[int]] = {}
    for index, item in enumerate(geometry.geometryObjects):
        there.setdefault(str(model.frames[item.parentFrame].name), []).append(index)
    found = []
    for link, own in robot.link_geometry.items():
        found += list(zip(own, there.get(link, []), strict=False))
    return found


def _shape(item: Any) -> np.ndarray:
    """Return the numbers of a shape: its triangles' corners in an order of their own, or its kind and sizes."""
    shape, kind = item.geometry, type(item.geometry).__name__
    if hasattr(shape, "num_tris"):
        faces = [[face[0], face[1], face[2]] for face in map(shape.tri_indices, range(shape.num_tris))]
        corners = np.asarray(shape.vertices())[np.array(faces)].reshape(-1, 3)
        flat = np.sort(corners.round(6).view([("", float)] * 3).reshape(-1))
        return flat.view(float)
    sizes = {"Box": ("halfSide",), "Sphere": ("radius",), "Cylinder": ("radius", "halfLength")}[kind]
    return np.concatenate([[float(len(kind))], *(np.atleast_1d(getattr(shape, size)) for size in sizes)])


def _placed(model: Any, geometry: Any, q: np.ndarray) -> list[np.ndarray]:
    data, placed = model.createData(), geometry.createData()
    pin.updateGeometryPlacements(model, data, geometry, placed, q)
    return [pose.homogeneous.copy() for pose in placed.oMg]


def _difference_of_words(robot: Robot, model: Any, geometry: Any, srdf: Path) -> str:
    """Return in what hdplan reads the SRDF otherwise than Pinocchio: pairs that are left out, values of states."""
    geometry.addAllCollisionPairs()
    before = _linked(model, geometry)
    try:
        pin.removeCollisionPairs(model, geometry, str(srdf))
        pin.loadReferenceConfigurations(model, str(srdf))
    except (ValueError, RuntimeError, IndexError):
        return ""
    removed, ours = before - _linked(model, geometry), {frozenset(pair) for pair in robot.semantics.disabled} & before
    if removed != ours:
        return f"pairs {sorted(map(sorted, ours))} and {sorted(map(sorted, removed))}"
    for name, groups in robot.semantics.states.items():
        for joint, value in ((j, v) for state in groups.values() for j, v in state.items() if j in {*model.names}):
            kind = model.joints[model.getJointId(joint)]
            expected = model.referenceConfigurations[name][kind.idx_q]
            if kind.nq == 1 and abs(expected - value) > CLOSE:  # Pinocchio passes over joints without limits
                return f"state {name}, joint {joint}: {value} and {expected}"
    return ""


def _linked(model: Any, geometry: Any) -> set[frozenset[str]]:
    """Return the pairs of links that are compared."""
    links = [str(model.frames[item.parentFrame].name) for item in geometry.geometryObjects]
    return {frozenset((links[pair.first], links[pair.second])) for pair in geometry.collisionPairs}
