"""One path: a checkout with links, one without, the sdist and the wheel hold the same files, each once."""

from __future__ import annotations

import importlib.util
import json
import os
import pkgutil
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import hdplan

ROOT = Path(__file__).resolve().parent.parent
HATCH = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]
LINKS = ("planner", "distance", "scenes", "cli.py")
PLACES = {"hdplan": ROOT / "src" / "hdplan", **{f"hdplan/{name}": ROOT / name for name in LINKS}}
BUILD = "import json, sys; from hatchling import build; print(json.dumps(getattr(build, sys.argv[1])(sys.argv[2])))"
COMPILED = ("_loops.abi3.so", "_loops.pyd")


def files() -> set[str]:
    """Names of the files that the wheel has to hold: those of the tree, without C and what it makes."""
    found = set()
    for name, place in PLACES.items():
        for path in [place] if place.is_file() else place.rglob("*"):
            below = path.relative_to(place).parts
            if not path.is_file() or path.suffix in (".c", ".h", ".pyc") or path.name in COMPILED:
                continue
            if name != "hdplan" or below[0] not in LINKS:
                found.add("/".join((name, *below)))
    return found


def build(tree: Path, kind: str, into: Path, **env: str) -> Path:
    """Build a wheel or an sdist of a tree as pip does, in a process of its own."""
    into.mkdir(exist_ok=True)
    done = subprocess.run(
        [sys.executable, "-c", BUILD, f"build_{kind}", str(into)],
        cwd=tree,
        env={**os.environ, "HDPLAN_BUILD_LOOPS": "0", **env},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return into / json.loads(done.stdout.splitlines()[-1])


def wheel_files(wheel: Path) -> dict[str, bytes]:
    """Names of hdplan's files in a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        assert len(archive.namelist()) == len(set(archive.namelist()))
        return {name: archive.read(name) for name in archive.namelist() if name.startswith("hdplan/")}


@pytest.fixture(scope="module")
def without_links(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tree as `git -c core.symlinks=false` lays it: a link is a file that holds where it leads."""
    tree = tmp_path_factory.mktemp("tree") / "checkout"
    tree.mkdir()
    ignore = shutil.ignore_patterns("__pycache__", *COMPILED)
    for name in {each.partition("/")[0] for each in HATCH["sdist"]["only-include"]}:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, tree / name, symlinks=True, ignore=ignore)
        else:
            shutil.copy(ROOT / name, tree)
    for name in LINKS:
        link = tree / "src" / "hdplan" / name
        if link.is_symlink():
            target = os.readlink(link)
            link.unlink()
            link.write_text(target)
    return tree


@pytest.fixture(scope="module")
def sdist(without_links: Path) -> Path:
    return build(without_links, "sdist", without_links.parent / "sdist")


def test_wheels_of_checkout_and_sdist_are_one_and_whole(without_links: Path, sdist: Path, tmp_path: Path) -> None:
    """That of a tree without links with the loops, where there is a C compiler; never with their source."""
    held = wheel_files(build(without_links, "wheel", tmp_path / "none", HDPLAN_BUILD_LOOPS="1"))
    compiled = [held.pop(f"hdplan/{name}") for name in COMPILED if f"hdplan/{name}" in held]
    assert compiled or not any(map(shutil.which, ("cc", "gcc", "clang")))
    assert set(held) == files()
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    (tree,) = [path for path in tmp_path.iterdir() if path.name != "none"]
    assert held == wheel_files(build(tree, "wheel", tmp_path / "sdist"))
    assert held == wheel_files(build(ROOT, "wheel", tmp_path / "links"))


def test_without_a_compiler_the_wheel_is_built_without_loops(without_links: Path, tmp_path: Path) -> None:
    wheel = build(without_links, "wheel", tmp_path, HDPLAN_BUILD_LOOPS="1", PATH=str(tmp_path), CC="no_compiler")
    assert wheel.name.endswith("-py3-none-any.whl")
    assert set(wheel_files(wheel)) == files()


def test_the_sdist_holds_everything_once(sdist: Path) -> None:
    with tarfile.open(sdist) as archive:
        members = [member for member in archive.getmembers() if not member.isdir()]
        assert all(member.isfile() for member in members)
        names = [member.name.partition("/")[2] for member in members]
        contents = [archive.extractfile(member).read() for member in members]
    assert len(names) == len(set(names))
    large = [content for content in contents if len(content) > 500]
    assert len(large) == len(set(large))
    for folder in ("planner", "distance", "scenes", "src/hdplan/verify", "tests", "docs", ".ci"):
        there = {
            path.relative_to(ROOT).as_posix()
            for path in (ROOT / folder).rglob("*")
            if path.is_file() and "__pycache__" not in path.parts
        }
        assert there == {name for name in names if name.startswith(f"{folder}/")}
    assert not {Path(name).name for name in names} & set(COMPILED)


def test_an_editable_install_without_links_has_one_path(without_links: Path, tmp_path: Path) -> None:
    wheel = build(without_links, "editable", tmp_path)
    with zipfile.ZipFile(wheel) as archive:
        (path,) = [archive.read(name).decode().strip() for name in archive.namelist() if name.endswith(".pth")]
    code = "from hdplan import cli, scenes, verify; print(*(each.__file__ for each in (cli, scenes, verify)))"
    env = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True)
    expected = ("cli.py", "scenes/__init__.py", "src/hdplan/verify/__init__.py")
    assert done.stdout.split() == [str(without_links / name) for name in expected], done.stderr


def test_every_module_has_the_path_of_its_file() -> None:
    """Breakpoints, coverage and tracebacks see planner/plan.py, never a link to it."""
    names = [found.name for found in pkgutil.walk_packages(hdplan.__path__, "hdplan.", onerror=lambda _: None)]
    origins = {str(spec.origin) for name in names if (spec := importlib.util.find_spec(name))}
    assert len(origins) > 300
    assert {origin for origin in origins if os.path.realpath(origin) != origin} == set()
