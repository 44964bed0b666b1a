"""The reference: griffe learns the public names, the words beside fields, and an example of each name from the pages.

Packages find their public names in their stubs (`lazy_names`), which griffe cannot see. A build without a public name,
or with a class that has no example, fails.
"""

from __future__ import annotations

import ast
import importlib
import io
import re
import tokenize
import zlib
from dataclasses import replace
from pathlib import Path
from textwrap import indent

import griffe
from markdown.extensions.toc import slugify
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError

DOORS = ("hdplan", "hdplan.control", "hdplan.distance", "hdplan.symbolic")
NO_ENTRY = {"hdplan.__version__", "hdplan.symbolic.distance"}  # a text, and a second name of a function
TOOLS = ("noqa", "type:", "fmt:")  # comments for them
PAGES = Path(__file__).parent


class PublicNames(griffe.Extension):
    """Tells griffe what a package's `__all__` holds, adds examples, and makes a table of a class's fields."""

    def on_class_members(self, *, cls: griffe.Class, **_: object) -> None:
        """List the fields in the class's docstring, by the words in their own or in the comment beside them."""
        if cls.docstring is None:
            return
        lines = []
        for each in cls.members.values():
            if not isinstance(each, griffe.Attribute) or "property" in each.labels or each.name.startswith("_"):
                continue
            if words := comment(each.source) or (each.docstring.value if each.docstring else ""):
                lines.append(f"    {each.name}: {' '.join(words.split())}")
                each.docstring, each.annotation = None, unchecked(each.annotation)
        if lines:
            cls.docstring.value += "\n\nAttributes:\n" + "\n".join(lines)

    def on_package(self, *, pkg: griffe.Module, **_: object) -> None:
        """Set the names of the package and of its doors, and show each in use.

        Raises PluginError for a class without an example.
        """
        shown = examples()
        for door in DOORS:
            module = pkg[door.removeprefix("hdplan").lstrip(".")] if door != pkg.path else pkg
            module.exports = [*importlib.import_module(door).__all__]
            for name in (each for each in module.exports if module[each].is_class or module[each].is_function):
                public, text = f"{door.rpartition('.')[2]}.{name}", module[name].docstring
                if public not in shown and module[name].is_class:
                    raise PluginError(f"no example in these pages uses {public}")
                if public in shown and f"{public}(" not in text.value and "Examples:" not in text.value:
                    text.value += f"\n\nExamples:\n{indent(shown[public], '    ')}"


def examples() -> dict[str, str]:
    """The shortest example of each name in the pages' programs, which tests run: a statement, with the next use of a
    result, and its section."""
    found: dict[str, tuple[int, str]] = {}
    for page in sorted(PAGES.rglob("*.md")):
        for section in re.split(r"^#+ ", page.read_text(encoding="utf-8"), flags=re.MULTILINE):
            title = section.partition("\n")[0]
            place = f"../{page.relative_to(PAGES)}#{slugify(title, '-')}"
            for program in re.findall(r"^```python\n(.*?)^```", section, re.DOTALL | re.MULTILINE):
                lines, statements = program.splitlines(), ast.parse(program).body
                for number, each in enumerate(statements):
                    shown = [each]
                    if isinstance(each, ast.AnnAssign):
                        shown += [use for use in statements[number + 1 :] if used(ast.unparse(each.target), use)][:1]
                    code = "\n".join("\n".join(lines[part.lineno - 1 : part.end_lineno]) for part in shown)
                    text = f"```python\n{code}\n```\n\nFrom [{title}]({place}).\n"
                    for name in re.findall(r"\b(?:hdplan|control|distance|symbolic)\.\w+", ast.unparse(each)):
                        found[name] = min(found.get(name, (len(code), text)), (len(code), text))
    return {name: text for name, (_, text) in found.items()}


def used(name: str, statement: ast.stmt) -> bool:
    """True if a statement reads a name."""
    return any(isinstance(node, ast.Name) and node.id == name for node in ast.walk(statement))


def unchecked(annotation: str | griffe.Expr | None) -> str | griffe.Expr | None:
    """Return a type without the check that `Annotated` adds to it."""
    if isinstance(annotation, griffe.ExprBinOp):
        return replace(annotation, left=unchecked(annotation.left), right=unchecked(annotation.right))
    if not isinstance(annotation, griffe.ExprSubscript) or annotation.canonical_name != "Annotated":
        return annotation
    return next(iter(annotation.slice.elements))


def comment(source: str) -> str:
    """Return the words beside a field's lines, but for those to tools."""
    try:
        tokens = [*tokenize.generate_tokens(io.StringIO(source.strip()).readline)]
    except tokenize.TokenError:
        return ""
    found = (token.string.lstrip("# ") for token in tokens if token.type == tokenize.COMMENT)
    return " ".join(words for words in found if not words.startswith(TOOLS))


def on_post_build(config: MkDocsConfig) -> None:
    """Fail where the reference lacks a public name."""
    lines = zlib.decompress((Path(config.site_dir) / "objects.inv").read_bytes().split(b"\n", 4)[4]).decode()
    known = {line.split(" ")[0] for line in lines.splitlines()}
    names = {f"{door}.{name}" for door in DOORS for name in importlib.import_module(door).__all__}
    if missing := sorted(names - known - {*DOORS} - NO_ENTRY):
        raise PluginError(f"the reference lacks {', '.join(missing)}")
