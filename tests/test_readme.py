"""README is held to its word: its two commands and its Python run as they stand there, and its links lead somewhere."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import pytest

from hdplan import cli

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def run(line: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """Run one `hdplan …` command line in this process and return its exit code."""
    monkeypatch.setattr(sys, "argv", shlex.split(line))
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


def test_the_two_commands_are_there_and_ci_runs_them() -> None:
    lines = [line for line in README.splitlines() if line.startswith("python3 -m venv ")]
    assert len(lines) == 2
    assert lines[0] in blocks("sh")[0]
    assert lines[1] in blocks("sh")[1]
    assert "grep -E '^python3 -m venv ' README.md" in (ROOT / ".ci" / "run").read_text()


def test_the_main_job_does_what_the_readme_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = next(line for line in README.splitlines() if line.startswith("python3 -m venv ")).split("&& ")[-1]
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path)
    assert run(command.removeprefix(".venv/bin/"), monkeypatch) == 0
    printed = capsys.readouterr().out.splitlines()
    shown = blocks("text")[0].splitlines()
    assert [line.split()[:1] for line in printed] == [line.split()[:1] for line in shown]
    assert printed[0].startswith("certified: ")
    assert (tmp_path / "out" / "motion.png").stat().st_size > 10_000
    assert run("hdplan check panda_cage out/motion.json", monkeypatch) == 0


def test_the_readme_is_one_page() -> None:
    assert len(README.splitlines()) < 150


def test_the_first_page_of_the_site_agrees() -> None:
    """One picture, two commands, ten lines of Python and three figures, each as in README."""
    page = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    readme = README.replace("](docs/", "](")
    assert page.split("\n\n* **")[0] in readme  # the title, and what hdplan is
    for mark, count in (("![", 1), ("* **", 3)):
        lines = [line for line in page.splitlines() if line.startswith(mark)]
        assert len(lines) == count
        assert all(line in readme for line in lines)
    commands = re.findall(r"```sh\n(.*?)```", page, re.DOTALL)
    assert len(commands) == 2
    assert commands[0] in readme
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert code in readme
    assert len([line for line in code.splitlines() if line]) == 10


def test_every_link_and_picture_is_there() -> None:
    places = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", README)
    assert len(places) > 10
    for place in places:
        assert (ROOT / place).is_file(), place
