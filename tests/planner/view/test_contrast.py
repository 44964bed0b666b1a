"""Every word of the page can be read: 4.5 : 1 against its ground, from 11 px on, in both themes and all tabs; and all
that can be pressed is reached by keyboard."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.things import Thing
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.scene import Scene
from tests.planner.view.events import by_worker
from tests.planner.view.in_browser import Tabs, plainly, tab_of
from tests.planner.view.in_page import wait_for

pytestmark = pytest.mark.slow
STILL = "document.getAnimations().every((each) => each.playState !== 'running')"  # colours fade
FAINT = """() => {
  const parts = (color) => (color.match(/[\\d.]+/g) || [0, 0, 0, 0]).map(Number);
  const light = (color) => color.slice(0, 3).map((x) => x / 255).map((x) => (x <= 0.03928 ? x / 12.92
    : ((x + 0.055) / 1.055) ** 2.4)).reduce((sum, x, i) => sum + x * [0.2126, 0.7152, 0.0722][i], 0);
  const over = (top, under) => under.map((x, i) => x + (top[3] ?? 1) * (top[i] - x));
  const style = (each) => getComputedStyle(each);
  const up = (each) => { const all = []; for (let e = each; e; e = e.parentElement) all.push(e); return all; };
  const white = document.documentElement.dataset.mantineColorScheme === 'dark' ? [36, 36, 36] : [255, 255, 255];
  const found = [];
  for (const each of document.querySelectorAll('body *')) {
    const own = [...each.childNodes].filter((node) => node.nodeType === 3).map((node) => node.data.trim()).join('');
    const box = each.getBoundingClientRect(), text = each.tagName === 'INPUT' ? each.value : own;
    if (!text || text === '▬' || !box.width || each.closest('[data-disabled], :disabled, style, script')) continue;
    const seen = up(each).reduce((share, e) => share * style(e).opacity, 1);
    if (!seen || style(each).visibility === 'hidden') continue;
    const ground = up(each).reverse().reduce((under, e) => over(parts(style(e).backgroundColor), under), white);
    const ink = parts(style(each).color), color = over([...ink.slice(0, 3), (ink[3] ?? 1) * seen], ground);
    const [dark, bright] = [light(color), light(ground)].sort((a, b) => a - b);
    const size = parseFloat(style(each).fontSize);
    const ratio = (bright + 0.05) / (dark + 0.05);
    if (ratio < 4.5 || size < 11) found.push(`${text.slice(0, 40)}: ${ratio.toFixed(2)} : 1, ${size} px`);
  }
  return found;
}"""


@pytest.fixture
def viewer(scene: Scene, trajectory: Trajectory) -> Iterator[Viewer]:
    found = plainly(scene, (NAME, trajectory), ("half", trajectory.between(0, 9)))
    yield found
    found.close()


def test_every_word_can_be_read(tab: Tabs, viewer: Viewer) -> None:
    page: Any = tab(viewer.address())
    page.get_by_text("certified: at least").first.wait_for()
    by_worker(viewer, lambda: viewer.panel.handles.select(Thing("obstacle", "ball")))
    for theme in ("light", "dark"):
        page.emulate_media(color_scheme=theme)
        page.locator(f'[data-mantine-color-scheme="{theme}"]').wait_for(state="attached")
        for name in ("Plots", "Joints", "Scene", "Plan", "Layers"):
            tab_of(page, name)
            wait_for(page, STILL)
            assert page.evaluate(FAINT) == [], (theme, name)
    alone = "[...document.querySelectorAll('[data-do]')].filter(e => e.tagName !== 'SUMMARY' && e.tabIndex).length"
    assert page.evaluate(alone) == 0
