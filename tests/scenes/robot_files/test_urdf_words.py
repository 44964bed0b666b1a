"""Words that are none of URDF's or SRDF's: refused with what was meant, or known to be harmless and named."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_files.description import read_semantics, read_tree
from hdplan.scenes.robot_files.library import description_of, robot_names, source_of
from hdplan.scenes.robot_files.source import Source
from hdplan.scenes.robot_files.srdf_words import WORDS
from hdplan.scenes.robot_files.urdf_words import ATTRIBUTES, ELEMENTS, HARMLESS, HARMLESS_ATTRIBUTES
from hdplan.scenes.robot_spec import RobotSpec

ARM = """<robot name="arm">
  <link name="base">
    <inertial><origin xyz="0 0 0"/><mass value="1"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
    <collision><origin xyz="0 0 0" rpy="0 0 0"/><geometry><box size="1 1 1"/></geometry></collision>
  </link>
  <link name="tip"><collision><geometry><cylinder radius="0.1" length="1"/></geometry></collision>
    <visual/></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="tip"/>
    <origin xyz="0 0 1"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""
SRDF = """<robot name="arm"><group name="all"><chain base_link="base" tip_link="tip"/></group>
  <group name="arm"><joint name="turn"/><link name="tip"/><group name="all"/></group>
  <group_state name="home" group="arm"><joint name="turn" value="0.5"/></group_state>
  <end_effector name="hand" parent_link="tip" group="all" parent_group="arm"/>
  <virtual_joint name="world" type="fixed" parent_frame="map" child_link="base"/><passive_joint name="world"/>
  <disable_default_collisions link="tip"/><enable_collisions link1="base" link2="tip" reason="x"/>
  <disable_collisions link1="base" link2="tip" reason="Adjacent"/></robot>"""


def tree(folder: Path, text: str) -> tuple[str, ...]:
    (folder / "arm.urdf").write_text(text)
    return read_tree(Source(folder / "arm.urdf")).notes


def slips(word: str, rng: random.Random) -> set[str]:
    """One letter too many, one too few, two in the wrong order, the wrong case, a namespace."""
    at = rng.randrange(1, len(word))
    return {word + "x", word[:at] + word[at - 1 :], word[: at - 1] + word[at:], word.upper(), f"u:{word}"} - {word, ""}


@pytest.mark.parametrize("text", [ARM, SRDF])
def test_no_slip_of_the_pen_is_passed_over(tmp_path: Path, text: str) -> None:
    """No element or attribute can be misspelt, or of another namespace, without an error."""
    (tmp_path / "arm.urdf").write_text(ARM)
    robot = read_tree(Source(tmp_path / "arm.urdf"))

    def read(changed: str) -> None:
        changed = changed.replace('<robot name="arm"', '<robot name="arm" xmlns:u="urn:u"')
        if text is ARM:
            tree(tmp_path, changed)
        else:
            (tmp_path / "arm.srdf").write_text(changed)
            read_semantics(tmp_path / "arm.srdf", robot)

    read(text)
    rng, tried = random.Random(0), 0
    for form in (r"(<)({})\b", r"( )({})(?==)"):  # elements, attributes
        words = {word for _, word in re.findall(form.replace("{}", r"\w+"), text)}
        for word in sorted(words - {"visual"}):
            for slip in sorted(slips(word, rng)):
                places = list(re.finditer(form.replace("{}", word), text))
                place = rng.choice(places)
                changed = text[: place.start(2)] + slip + text[place.end(2) :]
                if place.group(1) == "<" and text[place.end() :].find(f"</{word}>") >= 0:
                    changed = re.sub(rf"<(/?){word}\b", rf"<\1{slip}", text)  # both tags
                with pytest.raises(InputError):
                    read(changed)
                tried += 1
    assert tried > 60


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            '<link name="tip"><collision>',
            '<link name="tip"><collisionx/><collision>',
            r"link 'tip': element 'collisionx' is not known \(did you mean 'collision'\?\)",
        ),
        ("<axis", "<axes", r"joint 'turn': element 'axes' is not known \(did you mean 'axis'\?\)"),
        ("<axis", "<frobnicate/><axis", r"joint 'turn': element 'frobnicate' is not known \(not part of URDF\)"),
        (' rpy="', ' ryp="', r"link 'base': origin: attribute 'ryp' is not known \(did you mean 'rpy'\?\)"),
        ("<axis", '<axis xyz="1 0 0"/><axis', "joint 'turn': <axis> occurs twice in <joint>"),
        ("<inertial>", "<inertial/><inertial>", "link 'base': <inertial> occurs twice in <link>"),
        ("<link ", "<Link ", r"element 'Link' is not known \(did you mean 'link'\?\)"),
        ('<origin xyz="0 0 1"/>', '<origin xmlns="u" xyz="0 0 1"/>', "element 'origin' is of the namespace 'u'"),
        ('<origin xyz="0 0 1"/>', '<origin xmlns:u="u" u:xyz="0 0 1"/>', "attribute 'xyz' is of the namespace 'u'"),
        ("</robot>", '<u:link xmlns:u="u"/></robot>', "element 'link' is of the namespace 'u'"),
        (
            "</robot>",
            '<x:include xmlns:x="http://www.w3.org/2001/XInclude" href="a"/></robot>',
            "element 'include' is of",
        ),
        ('<axis xyz="0 0 1"/>', '<axis xyz="1e-160 0 1e-160"/>', "joint 'turn': axis: xyz must not be 0"),
        ('name="turn"', 'name="universe"', "joint 'universe': the name stands for the world"),
        (
            "</robot>",
            '<joint name="b" type="fixed"><parent link="base"/><child link="tip"/></joint></robot>',
            "link 'tip' is the child of two joints, 'turn' and 'b'",
        ),
        ("</robot>", "<loop_joint/></robot>", "element 'loop_joint' is not known"),
        (
            "</robot>",
            '<x:include xmlns:x="http://www.ros.org/wiki/xacro" filename="a"/></robot>',
            "element 'xacro:include': the file is xacro",
        ),
        ('<mass value="1"/>', '<mass value="1">3</mass>', "link 'base': mass: holds the text '3'"),
        ("</collision>", "stray</collision>", "link 'base': collision: holds the text 'stray'"),
        ("<robot", '<!DOCTYPE robot [<!ENTITY a "1">]><robot', "document type definition"),
        ('<link name="tip">', '<link name="base">', "link 'base' appears 2 times"),
        ('type="revolute"', 'type="hinge"', "joint 'turn': unknown type 'hinge'"),
        ('xyz="0 0 1"/><axis', 'xyz="0 0 1_0"/><axis', "joint 'turn': origin: xyz must be 3 finite numbers"),
        ("<link name", "<link><origin xyz='0 0 1'/></link><link name", "origin in link is not part of URDF"),
    ],
)
def test_a_slip_is_named_with_what_was_meant(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = ARM.replace(old, new, 1 if "Link" not in new else -1)
    with pytest.raises(InputError, match=words):
        tree(tmp_path, text.replace("</link>", "</Link>") if "Link" in new else text)


def test_harmless_words_are_noted_once_or_free_at_the_top(tmp_path: Path) -> None:
    top = "<gazebo><u/></gazebo><transmission/><x:thing xmlns:x='urn:x'/><ros2_control/><!-- words --><?pi x?></robot>"
    assert tree(tmp_path, ARM.replace("</robot>", top)) == ()
    assert tree(tmp_path, ARM.replace("</robot>", "\\</robot>")) == ("not part of URDF, ignored: the text '\\'",)
    sensor = "<sensor name='eye'><origin xyz='1 0 0'/><contact x='1'/></sensor>"
    inside = f"<contact/>{sensor}<self_collision_checking/></link>"
    (note,) = tree(tmp_path, ARM.replace("</link>", inside).replace('upper="1"', 'upper="1" current="3"'))
    ignored = ("contact in link", "sensor in link", "self_collision_checking in link", "current of limit")
    assert note == f"not part of URDF, ignored: {', '.join(ignored)}"
    known = ({*words} for words in (*HARMLESS.values(), *HARMLESS_ATTRIBUTES.values()))
    assert all(why for words in (*HARMLESS.values(), *HARMLESS_ATTRIBUTES.values()) for why in words.values())
    assert not {*ELEMENTS, *ATTRIBUTES, *WORDS} & set().union(*known) - {"origin", "material"}


def test_spaces_around_numbers_say_nothing(tmp_path: Path) -> None:
    mimic = '<mimic joint="other" multiplier=" -1. " offset="\t.5"/></joint>'
    tree(tmp_path, ARM.replace("</joint>", mimic))
    assert read_tree(Source(tmp_path / "arm.urdf")).mimics == {"turn": ("other", -1.0, 0.5)}


def test_every_robot_of_the_library_is_read() -> None:
    for name in set(robot_names()) - {"ur_description/ur3.urdf"}:  # holds no link
        spec = RobotSpec(name=name)
        tree = read_tree(source_of(spec))
        if (srdf := description_of(spec)[2]) is not None:
            read_semantics(srdf, tree)
        assert tree.links, name


@pytest.mark.parametrize(
    ("mass", "moments", "words"),
    [
        ("-1", "1 0 0 1 0 1", "mass: value must not be negative"),
        ("x", "1 0 0 1 0 1", "mass: value must be a finite number"),
        ("1", "1 0 0 1 0 nan", "inertia: izz must be a finite number"),
    ],
)
def test_masses_that_are_none_are_refused(tmp_path: Path, mass: str, moments: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        tree(tmp_path, _weighed(mass, moments))


@pytest.mark.parametrize(
    ("mass", "moments", "possible"),
    [
        ("1", "1 0 0 1 0 2", True),
        ("1", "1 0 0 1 0 2.001", True),  # rounding
        ("1", "1 0 0 1 0 2.1", False),
        ("1", "1 2 0 1 0 2", False),  # a negative principal moment
        ("1", "-1e-3 0 0 1e-3 0 1e-3", False),
        ("0", "0 0 0 0 0 0", True),
        ("0", "1 0 0 1 0 1", False),
    ],
)
def test_inertias_that_no_body_has_are_found(tmp_path: Path, mass: str, moments: str, possible: bool) -> None:
    (tmp_path / "arm.urdf").write_text(_weighed(mass, moments))
    assert read_tree(Source(tmp_path / "arm.urdf")).impossible == (() if possible else ("base",))


def _weighed(mass: str, moments: str) -> str:
    keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    attributes = " ".join(f'{key}="{value}"' for key, value in zip(keys, moments.split(), strict=True))
    text = re.sub(r"<inertia .*?/>", f"<inertia {attributes}/>", ARM)
    return text.replace('<mass value="1"/>', f'<mass value="{mass}"/>')


def test_links_that_are_seen_and_have_no_shape_are_named(tmp_path: Path) -> None:
    text = re.sub(r'(<link name="tip">)<collision>.*?</collision>', r"\1", ARM)
    assert tree(tmp_path, text) == ("links without collision geometry, never checked: tip",)
    assert tree(tmp_path, re.sub(r"<collision>.*?</collision>", "", text)) == ()


def test_a_margin_of_a_safety_controller_is_named_and_a_chain_of_followers_has_an_end(tmp_path: Path) -> None:
    soft = '<safety_controller k_velocity="1" soft_lower_limit="{}" soft_upper_limit="1"/></joint>'
    assert tree(tmp_path, ARM.replace("</joint>", soft.format(-1))) == ()
    (note,) = tree(tmp_path, ARM.replace("</joint>", soft.format(-0.5)))
    assert note == "soft limits of safety controllers, not kept: turn [-0.5, 1]"
    chain = "".join(
        f'<link name="l{i}"/><joint name="j{i}" type="continuous"><parent link="tip"/><child link="l{i}"/>'
        f'<mimic joint="{f"j{i - 1}" if i else "turn"}"/></joint>'
        for i in range(1500)
    )
    with pytest.raises(InputError, match="mimic: follows through more than 64 joints"):
        tree(tmp_path, ARM.replace("</robot>", f"{chain}</robot>"))


def test_unknown_names_of_an_srdf_are_noted(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    robot = read_tree(Source(tmp_path / "arm.urdf"))
    srdf = tmp_path / "arm.srdf"

    def notes(text: str) -> tuple[str, ...]:
        srdf.write_text(f'<robot name="arm">{text}</robot>')
        return read_semantics(srdf, robot).notes

    assert notes('<disable_collisions link1="base" link2="tip" reason="Never"/><gripper name="x"><u/></gripper>') == ()
    assert notes("\\") == ("not part of SRDF, ignored: the text '\\'",)
    (note,) = notes('<disable_collisions link1="base" link2="tipp"/>')
    assert note == "the SRDF names links that the robot does not have: 'tipp' (did you mean 'tip'?)"
    (note,) = notes('<group name="a"><joint name="turm"/></group>')
    assert "joints that the robot does not have: 'turm' (did you mean 'turn'?)" in note
    assert len(notes('<group name="a"><chain base_link="bass" tip_link="tip"/></group>')) == 1
    (note,) = notes('<group_state name="s" group="a"><joint name="other" value="1"/></group_state>')
    assert "'other' (none is like it)" in note
    assert notes('<virtual_joint name="world" type="fixed"/><group name="a"><joint name="world"/></group>') == ()
    (note,) = notes('<disable_default_collisions link="tipp"/><passive_joint name="turn"/>')
    assert "links that the robot does not have: 'tipp'" in note
    for slip, words in (
        ('<disable_collision link1="base" link2="tip"/>', "'disable_collision' is not known"),
        ('<disable_collisions link1="base" link_2="tip"/>', "attribute 'link_2' is not known"),
        ('<enable_collision link1="base" link2="tip"/>', "'enable_collision' is not known"),
        ('<group_sate name="s"/>', r"'group_sate' is not known \(did you mean 'group_state'\?\)"),
        ('<pairs link1="base" link2="tip"/>', r"'pairs' is not known \(not part of SRDF\)"),
        ('<disable_collisions xmlns="u" link1="base" link2="tip"/>', "is of the namespace 'u'"),
        ('<group_state name="s" group="a"><joint name="turn" value="1_0"/></group_state>', "'1_0' is not a number"),
        ('<group_state name="s" group="a"><joint name="turn"/></group_state>', "one number is needed, found no value"),
        ('<group_state name="s"><joint name="turn" value="1 0"/></group_state>', "'turn': one number is .*2 values"),
        ('<group_state name="s"><joint name="turn"/><joint name="turn"/></group_state>', "'s': joint 'turn' appears 2"),
        ('<group_state name="s" group="a"/>' * 2, "group_state 's' of group 'a' appears 2 times"),
        ('<group name="a"><joint name="turn"/></group><group name="a"/>', "group 'a' appears 2 times; names must"),
        ("<group><joint name='turn'/></group>", "group: must have the attribute 'name'"),
        ('<group name="a"><chain base_link="base"/></group>', "'a': chain: must have the attribute 'tip_link'"),
        ('<disable_collisions link1="base"/>', "disable_collisions: must have the attribute 'link2'"),
    ):
        with pytest.raises(InputError, match=words):
            notes(slip)
