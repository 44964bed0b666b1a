"""Plain words: pages, notebooks, docstrings, help and messages, held to the glossary's English."""

from __future__ import annotations

import ast
import io
import json
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NOTEBOOKS = sorted((ROOT / "docs" / "tutorial").glob("*.ipynb"))
ROOMS = {name: ROOT / name for name in ("scenes", "distance", "planner", "tests", "benchmarks")}
ROOMS["verify"] = ROOT / "src/hdplan/verify"

# A sentence, or a part of it before a mark, that ends in a preposition; and words that belong to talk between people.
ENDS = re.compile(
    r"(?<=\w )(of|for|by|with|from|in|on|to|at|into|about|upon|against|between|without)\)?[.;:?!](?=\s|$)"
)
TALK = re.compile(r"\b(asked|said|told|in vain|brought along|as well it|look for at|stands? there twice)\b", re.I)
FENCED = re.compile(r"```.*?```|<!--.*?-->", re.DOTALL)
C_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
IDENTIFIER = re.compile(r"\w*(?:asked|said|told)\w*", re.I)
NAMED = re.compile(r"`[^`]*`|``[^`]*``|<!-- [\w ]+:")  # code, whose names may be any, and marks in pages
SCRIPTS = {"page_script.py", "c_library.py", "c_test_text.py", "recorded_page.py"}  # texts in other languages


def files_of(room: str, *suffixes: str) -> list[Path]:
    """The files of a room, but for this one, which has to name the words."""
    found = (path for suffix in suffixes for path in ROOMS[room].rglob(f"*{suffix}"))
    return sorted(path for path in found if path != Path(__file__))


def odd(text: str) -> list[str]:
    """Places of a text that break the rule, each with the words before it."""
    plain = NAMED.sub("name", text)
    found = [match for rule in (ENDS, TALK) for match in rule.finditer(plain)]
    return [plain[max(0, match.start() - 60) : match.end()] for match in found]


def texts(source: str) -> Iterator[tuple[int, str]]:
    """The texts of a module, with their lines: docstrings, and strings of several words, fields of an f-string as x."""
    tree = ast.parse(source)
    parts = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield node.lineno, "".join(str(p.value) if isinstance(p, ast.Constant) else "x" for p in node.values)
        elif (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and " " in node.value
            and id(node) not in parts
        ):
            yield node.lineno, node.value


@pytest.mark.core
@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_pages_are_in_plain_words(page: Path) -> None:
    assert odd(FENCED.sub("", page.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.name)
def test_notebooks_are_in_plain_words(notebook: Path) -> None:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    assert [odd("".join(cell["source"])) for cell in cells if cell["cell_type"] == "markdown"] == [
        [] for cell in cells if cell["cell_type"] == "markdown"
    ]


@pytest.mark.parametrize("room", ROOMS)
def test_docstrings_and_messages_are_in_plain_words(room: str) -> None:
    files = [path for path in files_of(room, ".py") if path.name not in SCRIPTS]
    files += [ROOT / "cli.py", *(ROOT / "src/hdplan").glob("*.py")] if room == "planner" else []
    found = {}
    for path in files:
        for line, text in texts(path.read_text(encoding="utf-8")):
            if words := odd(text):
                found[f"{path.relative_to(ROOT)}:{line}"] = words
    assert found == {}


def comments(source: str) -> Iterator[tuple[int, str]]:
    """The comments of a module, with the lines where they end: those on lines of their own joined, with a full stop."""
    lines, run = source.splitlines(), ""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            row = token.start[0]
            run += token.string.lstrip("# ")
            if lines[row - 1].lstrip().startswith("#") and row < len(lines) and lines[row].lstrip().startswith("#"):
                run += " "
            else:
                yield row, run.rstrip(".") + "."
                run = ""


def c_comments(source: str) -> Iterator[tuple[int, str]]:
    """The comments of C, with the lines where they begin, without breaks and marks, with a full stop."""
    for match in C_COMMENT.finditer(source):
        yield source.count("\n", 0, match.start()) + 1, " ".join(match.group()[2:-2].split()).rstrip(".") + "."


def named(source: str) -> Iterator[tuple[int, str]]:
    """The identifiers, those in texts and comments too, that the words of talk are a part of, with their lines."""
    for match in IDENTIFIER.finditer(source):
        if TALK.search(match.group().replace("_", " ")):
            yield source.count("\n", 0, match.start()) + 1, match.group()


@pytest.mark.parametrize("room", ROOMS)
def test_names_and_comments_are_in_plain_words(room: str) -> None:
    found = {}
    for path in files_of(room, ".py", ".c", ".h"):
        source = path.read_text(encoding="utf-8")
        notes = comments if path.suffix == ".py" else c_comments
        words = [*named(source), *((line, text) for line, text in notes(source) if odd(text))]
        found |= {f"{path.relative_to(ROOT)}:{line}": text for line, text in words}
    assert found == {}


def test_odd_words_are_found() -> None:
    assert [text for _, text in comments("# The bodies\n# it works with\nx = 1  # a link\n") if odd(text)] == [
        "The bodies it works with."
    ]
    assert list(named("x = 1\n_told_apart = x.saida")) == [(2, "_told_apart")]
    assert [text for _, text in c_comments("/* What\n   it works with */") if odd(text)] == ["What it works with."]
    assert odd("The bodies that it works with.") == ["The bodies that it works with."]
    assert odd("A link is asked.") == ["A link is asked"]
    assert odd("The bodies, with their `asked` values: by link, from 0 to 1.") == []
