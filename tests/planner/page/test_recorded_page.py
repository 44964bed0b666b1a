"""Laws of pages: they hold all that they show, nothing from elsewhere, and are drawn as they say, in a real browser."""

from __future__ import annotations

import dataclasses
import html
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.html_page import HtmlPage
from hdplan.planner.page.browser import Browser
from hdplan.planner.page.recorded_page import page_of
from hdplan.planner.proof.reading import ReadProof
from hdplan.planner.result import PlanResult
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.drawing.skins import INSET
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import derived
from hdplan.scenes.shapes import Box

SIZE = (700, 400)  # [px]: every pixel is drawn by the processor
LARGEST = 2_000_000  # [bytes] of a page
PHONE = (390, 844)  # [px]
TOUCH = """{{
  const target = document.getElementById("{target}"), box = target.getBoundingClientRect();
  target.setPointerCapture = () => 0;
  const finger = (kind, x, y) => target.dispatchEvent(new PointerEvent(kind, {{
    pointerId: 1, pointerType: "touch", bubbles: true, buttons: {buttons},
    clientX: box.left + x, clientY: box.top + y }}));
  finger("pointerdown", {first}); finger("pointermove", {last}); finger("pointerup", {last}); 0
}}"""


def data_of(page: HtmlPage) -> dict[str, Any]:
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page.html, re.S)
    assert found
    data: dict[str, Any] = json.loads(found[1])
    return data


def test_a_page_says_what_is_known(setup: Setup, motion: ShownMotion) -> None:
    """Title, verdict, joints, clearance and every pose are those of the motion, to 10 µm and 10 µrad."""
    page = page_of(setup, [motion])
    content = data_of(page)
    (drawn,) = content["motions"]
    assert content["title"] == page.title == "planar_arm · planar_arm"
    assert (drawn["verdict"], drawn["certified"]) == (motion.certificate.text, True)
    np.testing.assert_allclose(drawn["joints"], motion.joints, atol=1e-5)
    np.testing.assert_allclose(drawn["clearance"], 1e3 * motion.clearance, atol=1e-5)
    np.testing.assert_allclose(drawn["path"], motion.tip, atol=1e-5)
    poses = np.array(drawn["poses"])  # (joints, samples, 7)
    assert poses.shape[:2] == (setup.robot.model.njoints, len(motion.joints))
    np.testing.assert_allclose(np.linalg.norm(poses[..., 3:], axis=-1), 1.0, atol=1e-4)
    certifier = Certifier(setup)
    for row in (0, 40, 120):
        now = content["when"][row]
        pair = next(filter(None, certifier.closest(motion.curve.at_parameter(now))))
        shown = next(filter(None, content["closest"][row]))
        assert shown["pair"] == f"{pair.link} – {pair.other}"
        np.testing.assert_allclose(shown["points"], pair.points, atol=1e-5)
    assert [joint["name"] for joint in content["joints"]] == list(setup.robot.joint_names)


def test_the_page_of_the_docs_is_as_pages_are_today(setup: Setup, motion: ShownMotion) -> None:
    """In its style, its script and its colours; docs/measurements.md has the command that records it."""
    docs = (Path(__file__).resolve().parents[3] / "docs" / "panda_cage.html").read_text(encoding="utf-8")
    today = page_of(setup, [motion]).html
    for part in (r"<style>.*?</style>", r"<script>.*?</script>", r"linear-gradient\(.*?\)"):
        assert re.findall(part, docs, re.DOTALL) == re.findall(part, today, re.DOTALL) != []


def test_a_page_needs_nothing_from_elsewhere(setup: Setup, motion: ShownMotion) -> None:
    text = page_of(setup, [motion]).html
    assert not re.search(r"https?://|@import|url\(|<link|src=", text.replace("http://www.w3.org", ""))


@pytest.mark.core
def test_names_are_text_and_never_markup(setup: Setup, motion: ShownMotion) -> None:
    hostile = "</script><script>window.hurt = 1</script>"
    renamed = dataclasses.replace(setup, scene=dataclasses.replace(setup.scene, name=hostile))
    page = page_of(renamed, [dataclasses.replace(motion, name=hostile), dataclasses.replace(motion, name="other")])
    assert "<script>window.hurt" not in page.html
    assert data_of(page)["motions"][0]["name"] == hostile
    assert page._repr_html_().count("<") == 2  # the frame alone: what is inside is escaped


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["panda_cage", "panda_gate", "panda_carry"])
def test_a_pandas_page_is_small(name: str) -> None:
    result = hdplan.plan(hdplan.load_scene(name))
    page = result.show()
    assert len(page.html.encode()) <= LARGEST
    content = data_of(page)
    assert content["timeline"]["timed"] == (result.trajectory.times is not None)
    assert any("poses" in each for each in content["obstacles"]) == (name == "panda_gate")


def test_a_result_shows_itself(result: PlanResult, tmp_path: Path) -> None:
    page = result.show()
    assert page._repr_html_().startswith("<iframe srcdoc=")
    assert html.escape(result.certificate.text) in page._repr_html_()
    page.save(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == page.html
    for bad in ("page.txt", "none/page.html"):
        with pytest.raises(InputError):
            page.save(tmp_path / bad)
    assert sorted(tmp_path.iterdir()) == [tmp_path / "page.html"]
    with pytest.raises(InputError, match="does not hold the scene"):
        dataclasses.replace(result, requested=None).show()


def test_seven_joints_are_not_taken_for_a_pose(browser: Browser) -> None:
    """Each joint's value is shown as it is: the seven of a Panda once had four turned to a quaternion of length 1."""
    result = hdplan.plan(hdplan.load_scene("panda_cage"))
    browser.show(result.show(), SIZE)
    cells = "[...document.querySelectorAll('#joints td:nth-child(2)')]"
    for now, q in ((0.0, result.trajectory.positions[0]), (1.0, result.trajectory.positions[-1])):
        values = browser.run(f"page.now = {now}, page.paint(), {cells}.map(cell => cell.innerText)")
        np.testing.assert_allclose([float(value.split()[0]) for value in values], q, atol=6e-4)


def test_a_browser_draws_it(setup: Setup, motion: ShownMotion, browser: Browser) -> None:
    """The picture follows the motion, the slider and the keys move it, and the console is empty."""
    listening = "<script>window.wrong = []; addEventListener('error', (e) => wrong.push(e.message));</script>"
    page = page_of(setup, [motion])
    browser.show(HtmlPage(page.title, page.html.replace("<body>", listening, 1)), SIZE)
    assert browser.run("document.title") == page.title
    assert motion.certificate.text in browser.run("document.body.innerText")
    pictures = []
    for now in (0.0, 0.5, 1.0):
        browser.run(f"page.now = {now}; page.paint()")
        pictures.append(browser.run("document.getElementById('scene').toDataURL()"))
    assert len(set(pictures)) == 3
    ghosts = "page.stage.solids.filter(x => x.visible && x.alpha < 1)"  # none where the robot stands
    for now, seen in ((0.0, 0.5), (0.5, 1.0), (1.0, 0.5)):
        share = f"{ghosts}.filter(x => x.visible()).length / {ghosts}.length"
        assert browser.run(f"page.now = {now}; {share}") == seen
    browser.run("time.value = 0.25; time.dispatchEvent(new Event('input'))")
    assert browser.run("page.now") == pytest.approx(0.25)
    cells = "[...document.querySelectorAll('#joints td:nth-child(2)')]"
    values = browser.run(f"page.paint(), {cells}.map(cell => cell.innerText)")
    shown = [float(value.split()[0]) for value in values]
    np.testing.assert_allclose(shown, motion.curve.at_parameter(0.25), atol=2e-3)
    for key, now in (("End", 1.0), ("ArrowLeft", 0.99), ("Home", 0.0)):
        browser.run(f"document.dispatchEvent(new KeyboardEvent('keydown', {{key: '{key}'}}))")
        assert browser.run("page.now") == pytest.approx(now)
    before = browser.run("page.paint(), document.getElementById('scene').toDataURL()")
    browser.run("page.stage.azimuth += 1; page.paint()")
    assert browser.run("document.getElementById('scene').toDataURL()") != before
    assert browser.run("wrong") == []
    assert browser.run("page.stage.gl.getError()") == 0


def test_robots_in_one_place_do_not_flicker_and_the_ground_is_hidden_by_what_stands_on_it(
    setup: Setup, motion: ShownMotion, browser: Browser
) -> None:
    """Ghosts and the robots of other motions are smaller than the robot, each by another length; nothing is seen of a
    ground below a slab, even where its lines run from below the eye to the horizon."""
    slab = Obstacle("slab", Box((4.0, 4.0, 0.04)), Pose((0.0, 0.0, -0.03)))
    page = page_of(dataclasses.replace(setup, scene=derived(setup.scene, obstacles=(slab,))), [motion, motion])
    browser.show(page, (900, 600))
    last = "page.meshes[data.robot.at(-1)].joint"  # of all robots, the links that are farthest from the base
    edges = "mesh.high.map((high, i) => high - mesh.low[i])"
    grown = f"{edges}.map((edge, i) => edge * (Math.hypot(...place().slice(4 * i, 4 * i + 3)) - 1))"
    found = browser.run(f"page.stage.solids.filter(x => x.mesh.joint === {last}).map(({{mesh, place}}) => {grown})")
    assert sorted({round(max(each) / (-2.0 * INSET), 3) + 0.0 for each in found}) == [0.0, 1.0, 2.0, 3.0]
    browser.run("page.stage.look([-0.58, -0.5, 0.71], [0.23, -0.03, 0.21], 0.785, 1.3), page.paint()")
    seen = browser.run("document.getElementById('scene').toDataURL()")
    assert browser.run("page.ground.count = 0, page.paint(), document.getElementById('scene').toDataURL()") == seen


def test_planes_glide_along_the_motion(
    setup: Setup, motion: ShownMotion, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """Each keeps the two bodies apart that are closest then, by what the proof says, between the samples too."""
    file = tmp_path / "motion.json"
    motion.trajectory.save(file)
    scene = Path(str(setup.requested.source))
    proof = ReadProof(scene, file, hdplan.prove(scene, file).data)
    page, certifier = page_of(setup, [motion], proof=proof), Certifier(setup)
    content = data_of(page)
    assert len(content["planes"]) == len(content["when"])
    assert data_of(page_of(setup, [motion]))["planes"] == []
    for now, plane, near in zip(content["when"], content["planes"], content["closest"], strict=True):
        pair = next(filter(None, certifier.closest(motion.curve.at_parameter(now))))
        sides = (pair.points - plane["point"]) @ plane["normal"]
        assert sides[0] > -1e-4
        assert sides[1] < 1e-4
        assert plane["of"].startswith(next(filter(None, near))["pair"])
        assert plane["thick"] <= pair.distance + 1e-4
    browser: Browser = request.getfixturevalue("browser")
    browser.show(page, PHONE)
    first, second = content["when"][40:42]
    at = [browser.run(f"page.now = {now}, page.plane().point") for now in (first, 0.5 * (first + second), second)]
    if content["planes"][40]["of"] == content["planes"][41]["of"]:
        np.testing.assert_allclose(at[1], np.mean([at[0], at[2]], axis=0), atol=2e-5)
    assert "proven ≥" in browser.run("page.paint(), document.getElementById('plane-words').textContent")


def test_a_phone_shows_all_of_it(setup: Setup, motion: ShownMotion, browser: Browser) -> None:
    """Nothing is wider than the screen, the slider is in sight, a finger turns the scene, no word is below 11 px,
    and a plot is dragged to a moment."""
    browser.show(page_of(setup, [motion]), PHONE)
    assert browser.run("document.documentElement.scrollWidth <= innerWidth")
    box = "document.getElementById('time').getBoundingClientRect()"
    low, high = browser.run(f"[{box}.top, {box}.bottom]")
    assert 0 < low < high < PHONE[1]
    sizes = "[...document.querySelectorAll('body *')].map(e => parseFloat(getComputedStyle(e).fontSize))"
    assert min(browser.run(sizes)) >= 11.0
    before = browser.run("page.stage.azimuth")
    browser.run(TOUCH.format(target="scene", buttons=1, first="100, 100", last="160, 100"))
    assert browser.run("page.stage.azimuth") != before
    browser.run(TOUCH.format(target="clearance", buttons=1, first="200, 60", last="250, 60"))
    assert 0.2 < browser.run("page.now") < 0.9
