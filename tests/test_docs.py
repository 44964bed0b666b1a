"""README and docs/ are held to their word: their commands and options exist, their Python and their scenes run."""

from __future__ import annotations

import importlib
import json
import re
import shlex
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

import hdplan
from hdplan import cli
from hdplan.scenes.yaml_format.reader import shipped_jobs, shipped_scenes
from tests.commands import in_process

ROOT = Path(__file__).resolve().parent.parent
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
}
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))
NOTEBOOKS = sorted((ROOT / "docs" / "tutorial").glob("*.ipynb"))
APP: Any = typer.main.get_command(cli.app)
OPTION = re.compile(r"(?<![\w-])--?[a-z][a-z-]*")


def commands(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command with the words that call it."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


COMMANDS = dict(commands(APP))


def options(command: Any) -> set[str]:
    return {name for option in command.params for name in option.opts if name.startswith("-")} | {"--help"}


def blocks(page: str, *languages: str) -> list[str]:
    return re.findall(rf"^```(?:{'|'.join(languages)})\n(.*?)^```", PAGES[page], re.DOTALL | re.MULTILINE)


def calls(page: str) -> list[str]:
    """Arguments of `hdplan` in a page's shell blocks, transcripts and code spans, without comments."""
    lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
    lines += [line[2:] for block in blocks(page, "text") for line in block.splitlines() if line.startswith("$ ")]
    lines += re.findall(r"`(hdplan [^`\n]+)`", re.sub(r"^```.*?^```", "", PAGES[page], flags=re.DOTALL | re.MULTILINE))
    shown = (part for line in lines for part in line.split(" #")[0].split("&&"))
    return [part.split("hdplan ", 1)[1].strip() for part in shown if re.match(r"\s*(\.venv/bin/)?hdplan ", part)]


def unknown(call: str) -> str | None:
    """The command or options of a call that do not exist; None if all do."""
    words = call.split()
    for first in words[0].split("|"):
        if first.startswith("-"):
            found = options(APP)
        elif (first,) in COMMANDS:
            found = options(COMMANDS[first,])
        else:
            seconds = words[1].split("|") if len(words) > 1 else [path[1] for path in COMMANDS if path[0] == first]
            if not seconds or any((first, second) not in COMMANDS for second in seconds):
                return call
            found = set.intersection(*(options(COMMANDS[first, second]) for second in seconds))
        if missing := set(OPTION.findall(call)) - found:
            return f"{call}: {', '.join(sorted(missing))}"
    return None


@pytest.mark.parametrize("page", PAGES)
def test_every_command_and_option_exists(page: str) -> None:
    assert [wrong for call in calls(page) if (wrong := unknown(call))] == []
    every = set().union(*map(options, (APP, *COMMANDS.values())))
    alone = re.findall(r"`(--[a-z][a-z-]*)[^`]*`", PAGES[page])
    assert set(alone) <= every


def test_unknown_commands_and_options_are_found() -> None:
    for call in ("plann panda_cage", "plan a.yaml --sovler chomp", "study distances", "reproduce time|kink", "-z"):
        assert unknown(call), call


def test_every_command_and_option_stands_in_the_docs() -> None:
    page = PAGES["docs/command_line.md"]
    for path, command in COMMANDS.items():
        assert any(set(path) <= set(re.split(r"[\s|]", call)) for call in calls("docs/command_line.md")), path
        for option in command.params:
            names = [name for name in option.opts if name.startswith("-")]
            assert not names or any(name in OPTION.findall(page) for name in names), (path, names)


def test_install_lines_work_from_a_checkout() -> None:
    """hdplan is on no index: it is installed from its folder, and messages name the package that is missing."""
    extras = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])
    sources = {
        str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
        for folder in ("scenes", "distance", "planner", "benchmarks")
        for path in (ROOT / folder).rglob("*.py")
    }
    for name, text in {**PAGES, **sources, "cli.py": (ROOT / "cli.py").read_text()}.items():
        assert not re.search(r"pip install( -\S+| constraints.txt)* '?hdplan", text), name
        for named in re.findall(r"pip install[^`\n]* '?\.\[([a-z,]+)\]", text):
            assert set(named.split(",")) <= extras, name
    assert [extra for extra in extras if f"`{extra}` (" not in PAGES["docs/quickstart.md"]] == []


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")])
def test_the_python_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hdplan.planner.batch.many.cores", lambda: 1)  # a worker takes seconds to start
    for code in blocks(page, "python"):
        exec(compile(code, page, "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "yaml")])
def test_the_scenes_plan(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for scene in blocks(page, "yaml"):
        (tmp_path / "scene.yaml").write_text(scene)
        for line in ("hdplan plan scene.yaml -o motion.csv --quiet", "hdplan check scene.yaml motion.csv"):
            monkeypatch.setattr(sys, "argv", shlex.split(line))
            with pytest.raises(SystemExit) as caught:
                cli.main()
            assert caught.value.code == 0


def words(line: str) -> str:
    """A line of an output without figures, bars and the widths of its columns."""
    return " ".join(re.sub(r"[\d.e+-]*\d|[─█-▏]+", "#", line).split())


TRANSCRIPTS = [
    (page, block.splitlines())
    for page in PAGES
    for block in blocks(page, "text")
    if block.startswith("$ hdplan") and len(block.splitlines()) > 1
]


@pytest.mark.slow
@pytest.mark.parametrize(("page", "lines"), TRANSCRIPTS, ids=[f"{page}-{lines[0]}" for page, lines in TRANSCRIPTS])
def test_the_transcripts_show_what_the_commands_print(
    page: str, lines: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Their words are compared; an excerpt leaves lines out."""
    run = in_process(monkeypatch, capsys)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.chdir(tmp_path)
    call = shlex.split(lines[0])[2:]
    if "motion.json" in call:
        assert run("plan", call[1], "-o", "motion.json").code == 0
    printed = [words(line) for line in run(*call).out.splitlines()]
    assert [line for line in lines[1:] if words(line) not in printed] == []


@pytest.mark.parametrize(
    "door", [hdplan, hdplan.distance, hdplan.control, hdplan.symbolic], ids=lambda door: door.__name__
)
def test_every_public_name_is_used_by_code_that_runs(door: Any) -> None:
    code = [block for page in PAGES for block in blocks(page, "python")]
    code += [path.read_text(encoding="utf-8") for path in (*EXAMPLES, *NOTEBOOKS)]
    used = set(re.findall(r"\w+", "\n".join(code)))
    assert [name for name in door.__all__ if name not in used and name != "__version__"] == []


SHORTER = {"many_guesses": ("count = 256", "count = 16")}  # what is replaced; -m slow runs the whole


@pytest.mark.parametrize(
    ("example", "whole"),
    [
        pytest.param(path, whole, marks=[pytest.mark.slow] * (whole and path.stem in SHORTER), id=path.stem)
        for path in EXAMPLES
        for whole in ((False, True) if path.stem in SHORTER else (True,))
    ],
)
def test_the_examples_run(
    example: Path, whole: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = example.read_text(encoding="utf-8")
    assert len(code.splitlines()) < 60
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    if not whole:
        long, short = SHORTER[example.stem]
        assert code.count(long) == 1
        code = code.replace(long, short)
    exec(compile(code, str(example), "exec"), {"__name__": "__main__", "__file__": str(example)})
    assert example.stem not in SHORTER or "is certified" in capsys.readouterr().out
    assert f'--8<-- "examples/{example.name}"' in PAGES["docs/examples.md"]
    for picture in tmp_path.glob("*.png"):
        assert (example.parent / picture.name).is_file()


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_tutorial_runs(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") for cell in cells), "notebooks are kept without their output"
    names: dict[str, Any] = {"__name__": "__main__"}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), str(notebook), "exec"), names)
    assert f"(tutorial/{notebook.name})" in PAGES["docs/tutorial.md"]


@pytest.mark.parametrize("page", PAGES)
def test_every_file_that_is_named_exists(page: str) -> None:
    named = re.findall(r"`((?:planner|distance|scenes|tests|benchmarks|docs|src)/[\w./]+)`", PAGES[page])
    assert [name for name in named if not (ROOT / name).exists() and "NAME" not in name] == []


def test_every_benchmark_is_named_or_run_by_another() -> None:
    sources = {path.stem: path.read_text(encoding="utf-8") for path in sorted((ROOT / "benchmarks").glob("*.py"))}
    pages = "\n".join(PAGES.values())
    for name, source in sources.items():
        others = "\n".join(text for other, text in sources.items() if other != name)
        run = re.search(rf"\b{name}\b", re.sub(r'""".*?"""', "", others, flags=re.DOTALL))
        assert "__main__" not in source or f"benchmarks/{name}.py" in pages or run, name


def test_every_shipped_scene_is_named_and_in_the_gallery(monkeypatch: pytest.MonkeyPatch) -> None:
    """The gallery is as its command writes it."""
    pytest.importorskip("PIL", reason="the gallery's pictures need Pillow")
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    every = sorted(shipped_scenes() | shipped_jobs())
    for name in every:
        assert f"`{name}`" in PAGES["docs/scene.md"]
    assert sorted(path.stem for path in (ROOT / "docs" / "gallery").iterdir()) == every
    assert PAGES["docs/gallery.md"] == importlib.import_module("gallery").gallery(every)
