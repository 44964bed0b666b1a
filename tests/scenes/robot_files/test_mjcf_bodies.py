"""MJCF as URDF against an independent opinion: bodies, geoms and limits are where they were while the text was written;
what is damaged is refused."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_files.mjcf import SLIDE_LIMIT
from hdplan.scenes.robot_files.source import Source
from hdplan.scenes.robot_files.urdf_text import read_description
from tests.scenes.robot_files.mjcf_models import Model, Writer, rotation, transform

MODELS = 500


def written(model: Model, folder: Path) -> Path:
    for name, text in {**model.files, "robot.xml": model.text}.items():
        (folder / name).write_text(text)
    return folder / "robot.xml"


def numbers(element: ElementTree.Element | None, key: str) -> np.ndarray:
    assert element is not None
    return np.array([float(word) for word in element.get(key, "").split()])


def placed(element: ElementTree.Element) -> np.ndarray:
    roll, pitch, yaw = numbers(element.find("origin"), "rpy")
    turn = rotation([0, 0, 1], yaw) @ rotation([0, 1, 0], pitch) @ rotation([1, 0, 0], roll)
    return transform(turn, numbers(element.find("origin"), "xyz"))


def near(found: Sequence[float] | np.ndarray, expected: Sequence[float] | np.ndarray, within: float) -> bool:
    return bool(np.abs(np.asarray(found) - expected).max() < within)


def check(model: Model, urdf: ElementTree.Element, rng: np.random.Generator) -> int:
    """Compare a model with its URDF, at random coordinates; return how many bodies it has."""
    for link in urdf.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    robot = pin.buildModelFromXML(ElementTree.tostring(urdf, encoding="unicode"))
    data, joints = robot.createData(), {str(name): i for i, name in enumerate(robot.names)}
    assert {*joints} - {"universe"} == {joint.name for joint in model.joints}
    q, values = pin.neutral(robot), {}
    for joint in model.joints:
        values[joint.name] = value = float(rng.normal() * 2)
        kind = robot.joints[joints[joint.name]]
        q[kind.idx_q : kind.idx_q + kind.nq] = value if kind.nq == 1 else (np.cos(value), np.sin(value))
        assert (kind.nq == 2) is (joint.kind == "hinge" and joint.limits is None)
        if kind.nq == 1:
            ends = robot.lowerPositionLimit[kind.idx_q], robot.upperPositionLimit[kind.idx_q]
            assert near(ends, joint.limits or (-SLIDE_LIMIT, SLIDE_LIMIT), 1e-9)
    pin.framesForwardKinematics(robot, data, q)
    truth = model.world.poses(values, np.eye(4))
    links = {link.get("name"): link for link in urdf.findall("link")}
    for body in model.world.all():
        found = data.oMf[robot.getFrameId(body.name, pin.FrameType.BODY)].homogeneous
        assert near(found, truth[body.name], 1e-8)
        parts = links[body.name].findall("collision")
        assert len(parts) == len(body.geoms)
        for part, (shape, place, sizes) in zip(parts, body.geoms, strict=True):
            geometry = part.find(f"geometry/{shape}")
            own = placed(part)
            assert near(own[:3, 3], place[:3, 3], 1e-9)
            if shape in ("capsule", "cylinder"):  # round about their axes, and the same upside down
                assert abs(own[:3, 2] @ place[:3, 2]) == pytest.approx(1.0, abs=1e-9)
                sizes_read = np.append(numbers(geometry, "radius"), numbers(geometry, "length") / 2)
            else:
                assert near(own, place, 1e-9)
                sizes_read = {
                    "box": lambda each: numbers(each, "size") / 2,
                    "sphere": lambda each: numbers(each, "radius"),
                    "ellipsoid": lambda each: numbers(each, "radii"),
                }[shape](geometry)
            assert near(sizes_read, sizes, 1e-12)
    return len(model.world.all()) - 1


def test_bodies_geoms_and_limits_are_what_the_text_means(tmp_path: Path) -> None:
    rng, bodies, files = np.random.default_rng(1), 0, 0
    for seed in range(MODELS):
        model = Writer(seed).model()
        description = read_description(Source(written(model, tmp_path)))
        assert {file.name for file in description.files} == {"robot.xml", *model.files}
        bodies += check(model, description.root, rng)
        files += len(model.files)
    assert bodies > 2 * MODELS
    assert files > MODELS / 5


NO_NUMBERS = ("1_0", "nan", "inf", "0x1", "1,0", "\u0663", "1e", "--1", "1d0", "1 2 3 4 5 6 7", "")
FREE = ("name", "file", "rgba", "damping", "model")  # attributes that may say anything, or are not read


def damaged(text: str, rng: np.random.Generator) -> str:
    """A text that is no MJCF any more, in one word: an element, an attribute, a number, a choice."""
    root = ElementTree.fromstring(text)
    elements = [each for each in root.iter() if each is not root]
    element = elements[rng.integers(len(elements))]
    keys = [key for key in element.attrib if key not in FREE and element.tag != "default"]
    how = rng.integers(3) if keys else 0
    if how == 0:
        element.tag = str(
            rng.choice([element.tag + "s", element.tag.upper(), "u:" + element.tag, "replicate", "plugin"])
        )
        return ElementTree.tostring(root, encoding="unicode")
    key = keys[rng.integers(len(keys))]
    value = element.attrib[key]
    if how == 1:
        del element.attrib[key]
        element.set(str(rng.choice([key + "s", key.upper(), "_" + key, key[1:] + key[0]])), value)
    elif key in ("type", "angle", "eulerseq", "class", "childclass", "limited"):
        element.set(key, str(rng.choice([value + "x", value.upper() + " ", "0"])))
    else:
        words = value.split()
        words[rng.integers(len(words))] = str(rng.choice(NO_NUMBERS))
        element.set(key, " ".join(words))
    return ElementTree.tostring(root, encoding="unicode")


def test_damaged_models_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    for seed in range(MODELS, MODELS + 200):
        model = Writer(seed).model()
        name = str(rng.choice(["robot.xml", *model.files]))
        path = written(model, tmp_path)
        text = (tmp_path / name).read_text()
        for wrong in (text[: rng.integers(len(text))], damaged(text, rng)):
            (tmp_path / name).write_text(wrong)
            with pytest.raises(InputError) as error:
                print(wrong, "\n", read_description(Source(path)))
            assert str(error.value).startswith(f"robot.urdf: {path}: ")
