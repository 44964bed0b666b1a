"""YAML read in one pass: whatever the document, the values and refusals of PyYAML's own constructor."""

from __future__ import annotations

import datetime
import random

import pytest
import yaml

from hdplan.scenes import yaml_values
from hdplan.scenes.errors import InputError
from hdplan.scenes.yaml_values import read_mapping
from hdplan.verify import RejectedError
from hdplan.verify.balls import rejecting
from hdplan.verify.text import yaml_of

PLAIN = (
    *("0", "-1", "+1", "007", "0b11", "0x1F", "0o7", "1_000", "1:30", "-0", "123456789012345678901234567890"),
    *("1.", "-1.5", "+.5", ".5", "1e-05", "1.0e-5", "1.0e+5", "1.0E5", "1_0.5", "190:20:30.15", "-.inf", ".NaN"),
    *("true", "True", "yes", "Off", "TRUE", "tRUE", "on", "null", "Null", "~", "", "nul", "=", "<<", "2026-11-22"),
    *("1.5.2", "2026-11-22 20:00:00", "2026-99-99", "name", "a b", "é", "'1.5'", '"true"', '"\\u263a"', "''"),
    *("!!str 1", "!!int '3'", "!!float 1", "!!int x", "!what 1", "! 1", "&a 1", "*a", "!!binary aGk=", "[1, 2.5, x]"),
    *("{a: 1, b: 2}", "{a: 1, a: 2}", "{1: a, 1.0: b}", "{1: a, 0x1: b}", "{[1]: 2}", "{<<: {a: 1}, b: 2}"),
    *("!!set {a, b}", "[&b x, *b]", "&c [*c]", "{? a}"),
)


def outcome(text: str) -> object:
    try:
        return repr(read_mapping(text.encode()))  # tells 1 from 1.0 and True, and a nan is itself
    except InputError as error:
        return str(error)


def in_pyyamls_words(text: str, monkeypatch: pytest.MonkeyPatch) -> object:
    built = yaml_values._built

    def checked_only(content: str) -> object:
        built(content)
        return yaml_values._MORE

    with monkeypatch.context() as patch:
        patch.setattr(yaml_values, "_built", checked_only)
        return outcome(text)


@pytest.mark.parametrize("value", PLAIN)
def test_every_word_means_what_it_means_in_pyyaml(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    forms = (f"k: {value}", f"k: [{value}]", f"{value}: 1", f"- {value}", f"k: {value}\n---\nk: 1\n", f"---\n{value}")
    for text in forms:
        assert outcome(text) == in_pyyamls_words(text, monkeypatch), text


def test_random_documents_whole_and_damaged(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = random.Random(0)

    def value(depth: int) -> object:
        kind = rng.randrange(10 if depth else 8)
        match kind:
            case 0 | 1:
                large = rng.gauss(0, 1) * 10.0 ** rng.randrange(-30, 30)
                return rng.choice([rng.gauss(0, 1), large, float("inf"), -0.0])
            case 2:
                return rng.choice([rng.randrange(-99, 99), True, False, None, 2**70])
            case 3 | 4 | 5:
                return "".join(rng.choice("ab1.0-:#'\"[]{}, \n&*!é~=") for _ in range(rng.randrange(6)))
            case 6:
                return rng.choice(["yes", "no", "1.5", "null", "1e5", "0x1", "<<"])
            case 7:
                return datetime.date(2026, 11, 1 + rng.randrange(20))
            case 8:
                return [value(depth - 1) for _ in range(rng.randrange(4))]
        return {str(value(0)) or "k": value(depth - 1) for _ in range(rng.randrange(4))}

    whole = 0
    for _ in range(300):
        wanted = {"key": value(4), "more": value(3)}
        text = yaml.safe_dump(
            wanted, sort_keys=False, default_flow_style=rng.choice([True, False, None]), allow_unicode=True
        )
        assert outcome(text) == in_pyyamls_words(text, monkeypatch) == repr(wanted)
        whole += yaml_values._built(text) is not yaml_values._MORE
        at = rng.randrange(len(text))
        inserted = rng.choice("[]{}:,'\"&*!-#\n\t ")
        for damaged in (text[:at], text[:at] + inserted + text[at:], text[:at] + text[at + 1 :]):
            assert outcome(damaged) == in_pyyamls_words(damaged, monkeypatch), damaged
    assert whole > 150  # most need nothing of PyYAML


@pytest.mark.parametrize(
    "word", ["1_000", "1_0.5", "0x1F", "0b11", "010", "1:30", "190:20:30.15", "!!int 0x10", "&a 1_0"]
)
def test_numbers_that_are_not_decimal_digits_are_refused_by_line(word: str) -> None:
    """YAML 1.1 takes them for 1000, 31, 8, 90, ...: nobody who writes a scene means that."""
    with pytest.raises(InputError, match=r"line 2: .* is not a number in decimal digits"):
        read_mapping(f"a: 1\nk: [2.5, {word}]\n".encode())
    quoted = word.rpartition(" ")[2]
    assert read_mapping(f"k: '{quoted}'".encode()) == {"k": quoted}


@pytest.mark.parametrize("word", ["7", "-1", "+1", "007", "1.", "-1.5", "1.0e-5", "1.0E+5", ".inf", "-.Inf", "2e3"])
def test_numbers_in_decimal_digits_are_read(word: str) -> None:
    value = read_mapping(f"k: {word}".encode())["k"]
    assert value == (word if "e3" in word else float(word.replace(".inf", "inf").replace(".Inf", "inf")))


@pytest.mark.parametrize("end", ["---", "---\n", "\n---  \n\n", "---\r\n"])
def test_the_line_that_ros_prints_after_a_message_begins_nothing(end: str) -> None:
    for text in ("a: 1\n", "---\na: [1, {b: 2}]\n", "a: &x [1]\nb: *x\n", "a: |\n  text\n  ---\n"):
        assert outcome(text + end) == outcome(text)
        assert "second document" in str(outcome(f"{text}{end.strip()}\na: 1\n"))
    assert "second document" not in str(outcome("a: 1 ---\n"))  # which is a text
    assert outcome("---\n") == "is empty"


def test_a_mapping_that_merges_and_is_merged_keeps_its_own_keys() -> None:
    """A merge before the mapping, and one within."""
    a, b = {"x": 1, "y": 3}, {"x": 1, "y": 3, "z": 4}
    for text in (
        "a: &a {<<: {x: 1, y: 2}, y: 3}\nb: {<<: *a, z: 4}",
        "b: {<<: &a {<<: {x: 1, y: 2}, y: 3}, z: 4}\na: *a",
        "b: {<<: [&a {y: 3, <<: {x: 1, y: 2}}, {x: 5}], z: 4}\na: {<<: *a}",
    ):
        assert read_mapping(text.encode()) == yaml_of(text.encode()) == {"a": a, "b": b}
    for text in ("a: &a {x: 1, x: 2}\nb: {<<: *a}", "b: {<<: &a {x: 1, x: 2}}\na: *a"):
        with pytest.raises(InputError, match="appears twice"):
            read_mapping(text.encode())
        with pytest.raises(RejectedError, match="appears twice"):
            yaml_of(text.encode())


def test_yaml_that_readers_take_differently_is_refused_by_the_checker() -> None:
    """Nesting without end, what contains itself, other documents and tags."""
    for text in (
        *("a: " + "[" * 70 + "]" * 70, "[" * 100_000, "&x\na: *x", "&x [*x]", "a: *x", "a: &x 1\nb: &x 2"),
        *("a: 1\n---\nb: 2", "!!set {a}", "!!omap [a: 1]", "a: 0x10", "a: 1_0", "a: 010", "a: 1:30", "a: .nan"),
        *("a: !!python/none x", "1: a", "[a]: b", "{<<: 1}", "{<<: [1]}"),
    ):
        with pytest.raises(RejectedError), rejecting():
            yaml_of(text.encode())
    for text, value in {
        "": None,
        "a: &x {b: 1}\nc: *x": {"a": {"b": 1}, "c": {"b": 1}},
        "a: [1, -2.5, +3., .inf, -.INF, '4', yes, ~, 1e5]": {
            "a": [1, -2.5, 3.0, float("inf"), -float("inf"), "4", True, None, "1e5"]
        },
        "? a\n: |\n  b\n": {"a": "b\n"},
        "!!map {a: !!seq [!!str 1, !!float 2.5, !!int 3]}": {"a": ["1", 2.5, 3]},
    }.items():
        assert yaml_of(text.encode()) == value
