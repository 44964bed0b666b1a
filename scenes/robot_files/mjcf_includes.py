"""MJCF of several files as one: each `include` is replaced by the content of its file.

As MuJoCo does it: a file's root element falls away, its content takes the place of the `include`; names of files are
relative to the folder of the main file, or else to that of the file that names them; each file counts once.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.files import read_file
from hdplan.scenes.robot_files.xml_text import DEEPEST_LEVEL, check_depth, parse

ROOTS = ("mujoco", "mujocoinclude")


def with_includes(root: ElementTree.Element, path: Path) -> tuple[Path, ...]:
    """Put the files that an MJCF includes into it, and return them, in the order of the text.

    Raises:
        InputError: an `include` that names no file, one that cannot be read, is no MJCF, is empty or is there already;
            the whole is nested too deeply.
    """
    files = [path]
    _put_in(root, path, files, 0)
    check_depth(root)
    return tuple(files[1:])


def _put_in(element: ElementTree.Element, within: Path, files: list[Path], level: int) -> None:
    """Replace every `include` below an element that stands in the file `within`; `files` have been read."""
    if level > 2 * DEEPEST_LEVEL:  # of elements and of files
        raise InputError(f"include: elements and files are nested more than {2 * DEEPEST_LEVEL} levels deep")
    whole = []
    for below in element:
        if below.tag != "include":
            _put_in(below, within, files, level + 1)
            whole.append(below)
            continue
        name = below.get("file", "")
        if not name or len(below.attrib) > 1 or len(below):
            raise InputError(f"include: must have the attribute 'file' and nothing else, found {dict(below.attrib)}")
        file = _found(name, files[0], within)
        if any(file.resolve() == each.resolve() for each in files):
            raise InputError(f"include: '{name}' is included twice; each file may be included once")
        files.append(file)
        with naming(f"include: {file}"):
            root = parse(read_file(file), ROOTS)
            if not len(root):
                raise InputError("holds no element")
            _put_in(root, file, files, level + 1)
        whole.extend(root)
    element[:] = whole


def _found(name: str, main: Path, within: Path) -> Path:
    beside_main, beside_this = ((folder.parent / name).absolute() for folder in (main, within))
    return beside_main if beside_main.exists() or not beside_this.exists() else beside_this
