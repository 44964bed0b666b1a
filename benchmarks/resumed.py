"""Outcomes of a long run in a file: each is written as soon as it is known, and a second call resumes the run."""

from __future__ import annotations

import csv
import dataclasses
import sys
from collections.abc import Iterable, Iterator
from io import StringIO
from pathlib import Path
from typing import Any, TypeVar

from hdplan.scenes.output import write_output

T = TypeVar("T")
KINDS: dict[str, Any] = {"str": str, "int": int, "float": float, "bool": lambda word: word == "True"}


def read(file: Path | None, form: type[T]) -> list[T]:
    """Outcomes, of a dataclass, of an earlier run; a line that was cut off is left out."""
    if file is None or not file.is_file():
        return []
    lines = [line for line in file.read_text(encoding="utf-8").splitlines(keepends=True) if line.endswith("\n")]
    fields = dataclasses.fields(form)  # type: ignore[arg-type]
    if lines and lines[0].strip().split(",") != [field.name for field in fields]:
        sys.exit(f"{file}: not a file of this benchmark, or of an older form of it")
    return [form(*(KINDS[str(f.type)](row[f.name]) for f in fields)) for row in csv.DictReader(lines)]


def kept(file: Path | None, form: type[T], known: Iterable[T], new: Iterator[T]) -> Iterator[T]:
    """Pass new outcomes on, each written behind the known ones before the next is made."""
    if file is None:
        yield from new
        return
    done = StringIO()
    writer = csv.writer(done, lineterminator="\n")
    writer.writerow(field.name for field in dataclasses.fields(form))  # type: ignore[arg-type]
    writer.writerows(dataclasses.astuple(outcome) for outcome in known)  # type: ignore[call-overload]
    write_output(file, done.getvalue().encode())
    with file.open("a", newline="", encoding="utf-8", buffering=1) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        for outcome in new:
            writer.writerow(dataclasses.astuple(outcome))  # type: ignore[call-overload]
            yield outcome
