"""Laws of the cache: what others could have put there is neither read nor run, and no verdict loads code from it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import hdplan
from hdplan.distance.compiled import cache

pytestmark = pytest.mark.skipif(os.name == "nt", reason="there a user's folders are the user's")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that does not exist yet, two levels below one of the user's."""
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "above" / "home"))
    cache._warn_once.cache_clear()
    monkeypatch.setattr(cache, "_trusted", set())
    return tmp_path / "above" / "home"


def test_the_folder_is_the_users_alone(home: Path) -> None:
    cache.store("kind", "key", [1.5])
    assert home.stat().st_mode & 0o777 == 0o700
    assert cache.load("kind", "key", lambda value: value) == [1.5]


@pytest.mark.parametrize("open_one", ["home", "above"])
@pytest.mark.parametrize("mode", [0o777, 0o775, 0o722])
def test_a_cache_that_others_can_write_is_not_used(home: Path, open_one: str, mode: int) -> None:
    (home / "kind").mkdir(parents=True)
    text = json.dumps("planted")
    (home / "kind" / "key.json").write_text(f"{cache.content_key('kind', 'key', text)}\n{text}")
    (home if open_one == "home" else home.parent).chmod(mode)
    with pytest.warns(
        UserWarning, match=rf"is not used \(.*{open_one} can be written by others\), so expensive results"
    ):
        assert cache.load("kind", "key", lambda value: value) is None
    assert not cache.write_whole(home / "kind" / "other.json", b"{}")  # with one warning: warnings are errors here
    assert [file.name for file in (home / "kind").iterdir()] == ["key.json"]


def test_a_folder_like_tmp_above_it_will_do_but_not_as_the_cache_itself(home: Path) -> None:
    """Others may add files in such a folder, but not change or replace what is the user's."""
    cache.store("kind", "key", 1)
    home.parent.chmod(0o1777)
    cache._trusted.clear()
    assert cache.load("kind", "key", lambda value: value) == 1
    home.chmod(0o1777)
    cache._trusted.clear()
    with pytest.warns(UserWarning, match="is not used"):
        assert cache.load("kind", "key", lambda value: value) is None


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only the superuser can give files away")
@pytest.mark.parametrize("whose", ["home", "above"])
def test_another_users_folder_is_not_used(home: Path, whose: str) -> None:
    cache.store("kind", "key", 1)
    cache._trusted.clear()
    os.chown(home if whose == "home" else home.parent, 12345, -1)
    with pytest.warns(UserWarning, match="belongs to another user"):
        assert cache.load("kind", "key", lambda value: value) is None


def test_a_link_to_a_folder_of_others_is_not_used(home: Path, tmp_path: Path) -> None:
    """The folder to which a link leads counts."""
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    theirs.chmod(0o777)
    (theirs / "cache").mkdir(mode=0o700)
    home.parent.mkdir()
    home.symlink_to(theirs / "cache")
    with pytest.warns(UserWarning, match="theirs can be written by others"):
        assert cache.load("kind", "key", lambda value: value) is None


def test_neither_certificate_nor_proof_loads_what_is_compiled(tmp_path: Path) -> None:
    """A planted library of any name is never opened: the module that loads them is not even imported."""
    motion = tmp_path / "m.json"
    hdplan.plan(hdplan.load_scene("panda_cage")).save(motion)
    check = """
import sys, hdplan
scene = hdplan.load_scene("panda_cage")
assert hdplan.certify(scene, hdplan.Trajectory.load(sys.argv[1])).certified
hdplan.prove("panda_cage", sys.argv[1])
opened = [name for name in sys.modules if name.endswith((".c_library", ".row_function"))]
assert not opened, opened
"""
    subprocess.run([sys.executable, "-c", check, str(motion)], check=True)


def test_asking_is_quick_and_quiet(home: Path) -> None:
    """A folder that does not exist is no reason to warn."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cache.load("kind", "key", lambda value: value) is None
