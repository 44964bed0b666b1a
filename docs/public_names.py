"""The reference's names: griffe learns which are public, and what comments say of fields; a build without one fails.

Packages find their public names in their stubs (`lazy_names`), which griffe cannot see.
"""

from __future__ import annotations

import importlib
import io
import tokenize
import zlib
from dataclasses import replace
from pathlib import Path

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError

DOORS = ("hdplan", "hdplan.control", "hdplan.distance", "hdplan.symbolic")
NO_ENTRY = {"hdplan.__version__", "hdplan.symbolic.distance"}  # a text, and a second name of a function
TOOLS = ("noqa", "type:", "fmt:")  # comments for them


class PublicNames(griffe.Extension):
    """Tells griffe what a package's `__all__` holds, and makes a table of a class's fields."""

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
        """Set the names of the package and of its doors."""
        for door in DOORS:
            module = pkg[door.removeprefix("hdplan").lstrip(".")] if door != pkg.path else pkg
            module.exports = [*importlib.import_module(door).__all__]


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
