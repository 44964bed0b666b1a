"""Random robots as URDFs: trees with links without geometry, fixed and locked joints, all kinds of joints and axes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hdplan.scenes.array_types import Array
from sieges import meshes

AXES = np.vstack([np.eye(3), -np.eye(3), np.eye(3)[2], [[0, 0.6, 0.8]]])
RIGHT = np.array([0.0, 0.0, 0.0, np.pi / 2, -np.pi / 2, np.pi])


@dataclass
class Arm:
    """A robot's file and what a scene needs to know of it."""

    text: list[str] = field(default_factory=list)
    planned: list[str] = field(default_factory=list)
    locked: dict[str, float] = field(default_factory=dict)
    links: list[str] = field(default_factory=list)
    count: int = 0


def random_arm(rng: np.random.Generator, folder: Path) -> Arm:
    """Write arm.urdf into the folder, with its meshes."""
    arm, hostile = Arm(), rng.random() < 0.5
    _link(arm, "base", rng, folder, 0.15 if rng.random() < 0.7 else 0.0, hostile)
    tip, length = "base", 0.15
    for _ in range(int(rng.integers(1, 5))):
        if rng.random() < 0.25:
            tip, length = _grown(arm, tip, length, "fixed", rng, folder, hostile)
        tip, length = _grown(arm, tip, length, "moving", rng, folder, hostile)
        if rng.random() < 0.15:
            tip, length = _grown(arm, tip, length, "locked", rng, folder, hostile)
    if rng.random() < 0.25:
        branch = arm.links[int(rng.integers(len(arm.links)))]
        _grown(arm, branch, 0.1, "moving", rng, folder, hostile)
    if rng.random() < 0.2:
        _fingers(arm, tip, length, rng, folder)
    (folder / "arm.urdf").write_text('<robot name="arm">\n' + "\n".join(arm.text) + "\n</robot>\n")
    return arm


def _grown(
    arm: Arm, parent: str, length: float, how: str, rng: np.random.Generator, folder: Path, hostile: bool
) -> tuple[str, float]:
    arm.count += 1
    link, joint = f"link{arm.count}", f"joint{arm.count}"
    new = float(rng.uniform(0.1, 0.4))
    turns = rng.choice(RIGHT, 3) if rng.random() < 0.6 else rng.uniform(-1, 1, 3)
    if how == "fixed":
        kind, inner = "fixed", ""
    else:
        kind = str(rng.choice(["revolute", "revolute", "revolute", "continuous", "prismatic"]))
        axis = AXES[rng.integers(len(AXES))] * (rng.uniform(0.1, 3.0) if rng.random() < 0.2 else 1.0)
        reach = (0.1, 0.4) if kind == "prismatic" else (0.3, 3.0)
        low, high = -float(rng.uniform(*reach)), float(rng.uniform(*reach))
        effort, speed = float(rng.uniform(1, 80)), float(rng.uniform(0.5, 4))
        bounds = "" if kind == "continuous" else f' lower="{low!r}" upper="{high!r}"'
        inner = f'<axis xyz="{_words(axis)}"/><limit{bounds} effort="{effort!r}" velocity="{speed!r}"/>'
        if how == "locked":
            arm.locked[joint] = float(rng.uniform(low, high))
        else:
            arm.planned.append(joint)
    place = f'<origin xyz="0 0 {length!r}" rpy="{_words(turns)}"/>'
    ends = f'<parent link="{parent}"/><child link="{link}"/>'
    _link(arm, link, rng, folder, 0.0 if rng.random() < 0.2 else new, hostile)
    arm.text.append(f'<joint name="{joint}" type="{kind}">{ends}{place}{inner}</joint>')
    return link, new


def _fingers(arm: Arm, parent: str, length: float, rng: np.random.Generator, folder: Path) -> None:
    """Add two fingers, of which one follows the other: both are held."""
    for side, mimic in ((1.0, ""), (-1.0, '<mimic joint="finger_joint1" multiplier="1" offset="0.01"/>')):
        number = 1 if side > 0 else 2
        _link(arm, f"finger{number}", rng, folder, 0.05, False)
        arm.text.append(
            f'<joint name="finger_joint{number}" type="prismatic"><parent link="{parent}"/><child '
            f'link="finger{number}"/><origin xyz="0 {0.04 * side!r} {length!r}"/><axis xyz="0 {side!r} 0"/>'
            f'<limit lower="0.0" upper="0.05" effort="10" velocity="1"/>{mimic}</joint>'
        )
    arm.locked["finger_joint1"] = float(rng.uniform(0.0, 0.04))


def _link(arm: Arm, name: str, rng: np.random.Generator, folder: Path, length: float, hostile: bool) -> None:
    arm.links.append(name)
    mass = float(rng.uniform(0.2, 4.0))
    moments = mass * float(rng.uniform(0.002, 0.02)) * np.array([1.0, rng.uniform(0.6, 1.0), rng.uniform(0.5, 0.9)])
    inertia = " ".join(f'{key}="{value!r}"' for key, value in zip(("ixx", "iyy", "izz"), moments.tolist(), strict=True))
    about = f'<origin xyz="{_words(rng.uniform(-0.05, 0.05, 3))}" rpy="{_words(rng.uniform(-1, 1, 3))}"/>'
    parts = [f'<inertial>{about}<mass value="{mass!r}"/><inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial>']
    if length:
        parts += [_shape(name, k, rng, folder, length, hostile) for k in range(1 + int(rng.random() < 0.15))]
    arm.text.append(f'<link name="{name}">{"".join(parts)}</link>')


def _shape(name: str, number: int, rng: np.random.Generator, folder: Path, length: float, hostile: bool) -> str:
    width = float(rng.uniform(0.02, 0.06))
    inner = 0.8 * length
    kinds, shares = ["box", "cylinder", "sphere", "mesh", "capsule"], [0.3, 0.2, 0.1, 0.38, 0.02]
    match str(rng.choice(kinds, p=shares) if hostile else rng.choice(kinds[:3])):
        case "box":
            shape = f'<box size="{width!r} {width * 1.3!r} {inner!r}"/>'
        case "cylinder":
            shape = f'<cylinder radius="{width / 2!r}" length="{inner!r}"/>'
        case "capsule":
            shape = f'<capsule radius="{width / 2!r}" length="{inner - width!r}"/>'
        case "sphere":
            shape = f'<sphere radius="{min(width, inner / 2)!r}"/>'
        case _:
            forms = [kind for kind in meshes.KINDS if kind != "room"]
            file = f"{name}_{number}.{rng.choice(['obj', 'stl', 'ply'])}"
            meshes.write(folder / file, meshes.hostile(str(rng.choice(forms)), rng, 1.0))
            shape = f'<mesh filename="{file}" scale="{2 * width!r} {2 * width!r} {inner!r}"/>'
    turn = _words(rng.choice(RIGHT, 3)) if rng.random() < 0.1 else "0 0 0"
    return f'<collision><origin xyz="0 0 {length / 2!r}" rpy="{turn}"/><geometry>{shape}</geometry></collision>'


def _words(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
