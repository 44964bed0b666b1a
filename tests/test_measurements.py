"""The measured blocks of docs/measurements.md and README: their commands exist, blocks change whole or not at all."""

from __future__ import annotations

import argparse
import re
import runpy
import shlex
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
BENCHMARKS = ROOT / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

import measurements  # noqa: E402

PAGES = {page.name: page.read_text(encoding="utf-8") for page in measurements.PAGES}
COMMANDS = [command for page in PAGES.values() for command in measurements.blocks(page)]
TABLE = "| a | b |\n| --- | --- |\n| 1 | 2 |\n"
SAMPLE = f"""# Page

<!-- measured by: first.py -->
{TABLE}<!-- end -->

Words, <!-- a comment --> and

<!-- measured by: second.py --count 3 -->
Old.

*Measured by hand.*
<!-- end -->
"""


class Parsed(Exception):
    """A benchmark understands its arguments."""


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The sample as the only page; its benchmarks lie beside it, and the first fails."""
    path = tmp_path / "page.md"
    path.write_text(SAMPLE)
    (tmp_path / "first.py").write_text("print('half a table')\nraise SystemExit('the compiler is missing')\n")
    (tmp_path / "second.py").write_text("print('| new |\\n| --- |\\n| \\\\1 |')\n")
    monkeypatch.setattr(measurements, "ROOT", tmp_path)
    monkeypatch.setattr(measurements, "PAGES", (path,))
    return path


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["measurements.py", *arguments])
    return measurements.main()


def test_every_table_of_the_page_is_measured() -> None:
    left = measurements.BLOCK.sub("", PAGES["measurements.md"])
    assert [line for line in left.splitlines() if line.lstrip().startswith("|")] == []
    assert "benchmarks/peers.py" in " ".join(measurements.blocks(PAGES["README.md"]))


@pytest.mark.parametrize("command", sorted(set(COMMANDS)))
def test_every_command_exists_with_its_options(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def parse(self: argparse.ArgumentParser, *arguments: object) -> None:
        understood(self, *arguments)
        raise Parsed

    understood = argparse.ArgumentParser.parse_args
    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse)
    script, *words = shlex.split(command)
    monkeypatch.setattr(sys, "argv", [script, *words])
    with pytest.raises(Parsed):
        runpy.run_path(str(ROOT / script), run_name="__main__")
    for word in words:
        assert not word.startswith("docs/") or (ROOT / word).is_file(), word


def test_the_same_block_holds_the_same_everywhere() -> None:
    found: dict[str, str] = {}
    for page in PAGES.values():
        for command, content in measurements.blocks(page).items():
            assert found.setdefault(command, content) == content


def test_every_picture_is_drawn_by_a_command_that_the_page_names() -> None:
    drawn = set(re.findall(r"docs/[\w.]+", PAGES["measurements.md"]))
    pictures = {f"docs/{path.name}" for path in (ROOT / "docs").iterdir() if path.suffix in (".png", ".html")}
    assert pictures - drawn == set()


def test_a_block_is_replaced_whole_and_nothing_else() -> None:
    new = measurements.replaced(SAMPLE, "second.py --count 3", "New \\1.\n")
    assert measurements.blocks(new) == {"first.py": TABLE, "second.py --count 3": "New \\1.\n"}
    assert new.split("<!-- measured by: second")[0] == SAMPLE.split("<!-- measured by: second")[0]
    assert measurements.replaced(SAMPLE, "third.py", "New.\n") == SAMPLE


@pytest.mark.parametrize("torn", ["<!-- end -->\n\nWords", "<!-- measured by: second.py --count 3 -->"])
def test_a_torn_block_is_refused(torn: str) -> None:
    with pytest.raises(ValueError, match="needs its"):
        measurements.blocks(SAMPLE.replace(torn, "Words" if "Words" in torn else ""))


def test_a_failed_measurement_leaves_its_block_and_the_rest_is_written(
    page: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch) == 1
    found = measurements.blocks(page.read_text())
    assert found["first.py"] == TABLE
    assert found["second.py --count 3"].startswith(
        "| new |\n| --- |\n| \\1 |\n\n*Measured by `second.py --count 3` in "
    )
    assert "first.py: left as it was" in capsys.readouterr().err


def test_problems_that_are_not_there_are_requested(
    page: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    text = SAMPLE.replace("second.py --count 3", "second.py DIR/panda")
    page.write_text(text)
    assert run(monkeypatch, "second") == 1
    assert "--problems DIR" in capsys.readouterr().err
    assert page.read_text() == text
    (tmp_path / "second.py").write_text("import sys\nprint(sys.argv[1])\n")
    assert run(monkeypatch, "second", "--problems", str(tmp_path)) == 0
    block = measurements.blocks(page.read_text())["second.py DIR/panda"]
    assert block.startswith("DIR/panda")  # what was given, without the machine's own folder
    assert str(tmp_path) not in block


def test_an_interruption_keeps_what_is_finished(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measured(command: str, problems: Path | None) -> str:
        if command == "first.py":
            return "New.\n"
        raise KeyboardInterrupt

    monkeypatch.setattr(measurements, "measured", measured)
    assert run(monkeypatch) == 130
    assert page.read_text() == SAMPLE.replace(TABLE, "New.\n")


def test_a_name_chooses_and_an_unknown_one_is_refused(
    page: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "--list", "second") == 0
    assert capsys.readouterr().out == "second.py --count 3\n    Measured by hand.\n0.0 h for 0 of 1\n"
    with pytest.raises(SystemExit, match="2"):
        run(monkeypatch, "third")
    assert "second.py --count 3" in capsys.readouterr().err
    assert page.read_text() == SAMPLE
