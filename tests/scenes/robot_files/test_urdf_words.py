"""Words that are none of URDF's or SRDF's: slips are refused with what was meant, the rest is named."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_files.description import read_semantics, read_tree
from hdplan.scenes.robot_files.urdf_words import ATTRIBUTES, ELEMENTS

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


def tree(folder: Path, text: str) -> tuple[str, ...]:
    (folder / "arm.urdf").write_text(text)
    return read_tree(folder / "arm.urdf").notes


def slips(word: str, rng: random.Random) -> set[str]:
    """One letter too many, one too few, two in the wrong order, the wrong case."""
    at = rng.randrange(1, len(word))
    return {word + "x", word[:at] + word[at - 1 :], word[: at - 1] + word[at:], word.upper()} - {word, ""}


def test_slips_of_the_pen_are_refused_or_named(tmp_path: Path) -> None:
    """No element or attribute that says where a body is can be misspelt without a word."""
    assert tree(tmp_path, ARM) == ()
    rng, refused = random.Random(0), 0
    elements = {word for words in ELEMENTS.values() for word in words} & set(re.findall(r"<(\w+)", ARM))
    attributes = {word for words in ATTRIBUTES.values() for word in words} & set(re.findall(r'(\w+)="', ARM))
    for word in sorted(elements - {"visual"}):
        for slip in sorted(slips(word, rng)):
            text = re.sub(rf"<(/?){word}\b", rf"<\1{slip}", ARM)
            try:
                notes = tree(tmp_path, text)
            except InputError:
                refused += 1
            else:
                assert any(slip in note for note in notes), slip
    for word in sorted(attributes):
        for slip in sorted(slips(word, rng)):
            try:
                notes = tree(tmp_path, re.sub(rf'\b{word}="', f'{slip}="', ARM))
            except InputError:
                refused += 1
            else:
                assert any(slip in note for note in notes), slip
    assert refused > 100


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            '<link name="tip"><collision>',
            '<link name="tip"><collisionx/><collision>',
            r"link 'tip': element 'collisionx' is not known \(did you mean 'collision'\?\)",
        ),
        ("<axis", "<axes", r"joint 'turn': element 'axes' is not known \(did you mean 'axis'\?\)"),
        (' rpy="', ' ryp="', r"link 'base': origin: attribute 'ryp' is not known \(did you mean 'rpy'\?\)"),
        ("<axis", '<axis xyz="1 0 0"/><axis', "joint 'turn': <axis> occurs twice in <joint>"),
        ("<link ", "<Link ", r"element 'Link' is not known \(did you mean 'link'\?\)"),
    ],
)
def test_a_slip_is_named_with_what_was_meant(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = ARM.replace(old, new)
    with pytest.raises(InputError, match=words):
        tree(tmp_path, text.replace("</link>", "</Link>") if "Link" in new else text)


def test_what_vendors_add_is_named_once_or_free_at_top_level(tmp_path: Path) -> None:
    top = "<gazebo/><transmission/><x:thing xmlns:x='urn:x'/><ros2_control/><!-- words --></robot>"
    assert tree(tmp_path, ARM.replace("</robot>", top)) == ()
    inside = "<contact/><x:proximity xmlns:x='urn:x'/><self_collision_checking/></link>"
    (note,) = tree(tmp_path, ARM.replace("</link>", inside).replace('upper="1"', 'upper="1" current="3"'))
    assert note == (
        "not part of URDF, ignored: contact in link, proximity in link, self_collision_checking in link, "
        "current of limit"
    )


def test_links_that_are_seen_and_have_no_shape_are_named(tmp_path: Path) -> None:
    text = re.sub(r'(<link name="tip">)<collision>.*?</collision>', r"\1", ARM)
    assert tree(tmp_path, text) == ("links without collision geometry, never checked: tip",)
    assert tree(tmp_path, re.sub(r"<collision>.*?</collision>", "", text)) == ()


def test_what_an_srdf_names_and_is_not_there_is_named(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    robot = read_tree(tmp_path / "arm.urdf")
    srdf = tmp_path / "arm.srdf"

    def notes(text: str) -> tuple[str, ...]:
        srdf.write_text(f'<robot name="arm">{text}</robot>')
        return read_semantics(srdf, robot).notes

    assert notes('<disable_collisions link1="base" link2="tip" reason="Never"/><gripper name="x"/>') == ()
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
    ):
        with pytest.raises(InputError, match=words):
            notes(slip)
