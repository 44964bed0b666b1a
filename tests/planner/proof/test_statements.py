"""Statements of proofs: what is missing is named first, no number says more than is proven, no name adds a line."""

from __future__ import annotations

import json
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from hdplan import cli
from hdplan.verify import kernel
from hdplan.verify.balls import shown
from hdplan.verify.checking import check
from hdplan.verify.kernel import IN_PART
from hdplan.verify.reading import read_world
from hdplan.verify.verdict import digits, millimetres, statement
from hdplan.verify.world import World

from .conftest import Honest
from .forging import BALL, EVERY, LIMITS, files, forge
from .worlds import packed, unpacked


def claiming(proof: bytes, claims: list[str], clearance: float) -> bytes:
    """A proof that claims something else."""
    head, world, rest = unpacked(proof)
    return packed({**head, "claims": claims, "clearance": clearance}, world, rest)


@pytest.mark.parametrize("claim", EVERY[1:])
def test_a_claim_that_is_missing_is_named_in_the_first_line(
    claim: str, honest: Honest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command's exit code says so, too."""
    given, _, _, true = honest
    lacking = claiming(true, [x for x in EVERY if x != claim], 0.01)
    verdict, _ = check(*given, lacking)
    assert not verdict.whole
    assert verdict.text.splitlines()[0] == f"accepted in part; NOT proven by this file: {claim}"
    assert claim not in re.findall(r"also proven: (.*)", verdict.text)[0].split(", ")
    if claim == "goal":
        (tmp_path / "m.proof").write_bytes(lacking)
        monkeypatch.setattr("sys.argv", ["hdplan", "verify", *map(str, given), str(tmp_path / "m.proof")])
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert end.value.code == IN_PART == 4
        assert capsys.readouterr().out.startswith("accepted in part; NOT proven by this file: goal\n")


def test_clearances_that_are_not_reached_are_missing(honest: Honest) -> None:
    given, _, _, true = honest
    lacks = "a clearance of 10 mm (obstacles)"
    for claims, least, lacking in ((EVERY[1:], 0.009, lacks), (EVERY, 0.009, ""), (EVERY[1:], 0.01, "")):
        verdict, _ = check(*given, claiming(true, claims, least))
        assert verdict.whole == (not lacking)
        assert lacking in verdict.text.splitlines()[0]
        assert "20 mm from obstacle o" in verdict.text  # which has a clearance of its own


def test_no_length_is_printed_above_the_one_that_is_proven(honest: Honest) -> None:
    rng = np.random.default_rng(0)
    lengths = [*(10.0 ** rng.uniform(-12, 1, 2000)), *(rng.integers(1, 10**6, 500) / 10**6), 0.3, 5e-324, 1e-300]
    for length in [float(x) for each in lengths for x in (each, np.nextafter(each, 0))]:
        printed = Fraction(millimetres(length).removesuffix(" mm")) / 1000
        assert 0 <= Fraction(length) - printed < Fraction(1, 10**9)
        assert float(digits(length)) == length
        assert Fraction(digits(length, 1000)) == Fraction(digits(length)) * 1000
    least = {"obstacles": 0.0, "own": {"o": 0.123456789999}, "self": 0.0}
    world = World({**honest[1], "held": {"at rest": 0.1234567890123}, "clearances": least}, {})
    text, _ = statement(world, {"clearance": 0.029999999999, "self_clearance": 0.0123456789, "claims": []})
    assert "at least 29.999999 mm from every obstacle; 123.456789 mm from obstacle o\n" in text
    assert "at least 12.345678 mm from one another\n" in text
    assert 'held: "at rest" at 0.1234567890123\n' in text


def test_a_name_adds_nothing_to_the_statement(honest: Honest) -> None:
    """Not another obstacle's clearance, nor another pair."""
    world = json.dumps(honest[1])
    for name in ("o; 900 mm from p", "base-fore, o", 'o"; 900 mm from "p', "o\n  links and held objects", "o from p"):
        other = json.loads(world.replace('"o"', json.dumps(name)))
        text, _ = statement(World(other, {}), {"clearance": 0.01, "self_clearance": 0.01, "claims": []})
        (own,) = re.findall("10 mm from every obstacle; (.*)", text)
        quoted = shown(json.dumps(name))
        assert own == f"20 mm from obstacle {quoted}"
        (still,) = re.findall("not compared, both stand still: (.*)", text)
        assert still == f"base and obstacles {quoted}"
        assert text.count("\n") == statement(
            World(honest[1], {}), {"clearance": 0.01, "self_clearance": 0.01, "claims": []}
        )[0].count("\n")


def test_still_links_are_listed_beside_obstacles(tmp_path: Path) -> None:
    """A wall through the arm, of which one joint alone moves."""
    wall = {"name": "wall", "shape": {"type": "box", "size": [1, 1, 0.1]}, "pose": {"position": [0, 0, 0.9]}}
    scene = {
        "robot": {"urdf": "r.urdf", "group": ["g"], "locked": {"a": 0, "b": 0}}, "obstacles": [wall, BALL],
        "start": {"joints": [0]}, "goal": {"joints": [1]},
    }  # fmt: skip
    given = files(tmp_path, scene, {"joint_names": ["g"], "positions": [[0], [1]]})
    reading = read_world(*given)
    verdict, _ = check(*given, forge(reading.world, reading.hashes, LIMITS))
    (line,) = re.findall("not compared, both stand still: (.*)", verdict.text)
    assert line == "base, fore, up and obstacles wall, o"
    assert "held: a at 0, b at 0" in verdict.text


@pytest.mark.parametrize("world", ["[" * 100_000, '{"a": 1, "a": 1}', "nan", "\ud800", '{"hdplan_world": 3}', "[]", ""])
def test_the_kernel_alone_rejects_worlds_that_are_none(
    world: str, honest: Honest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files_ = tmp_path / "w.json", tmp_path / "m.proof"
    files_[0].write_bytes(world.encode(errors="surrogatepass"))
    files_[1].write_bytes(honest[3])
    monkeypatch.setattr("sys.argv", ["kernel", *map(str, files_)])
    assert kernel.main() == 1
    assert capsys.readouterr().out.startswith("rejected: ")
    files_[0].write_text(json.dumps(honest[1]))
    assert kernel.main() == 0
    assert capsys.readouterr().out.startswith("accepted: ")
