"""Outcomes of a campaign of random changes by their kind, kept in a file so that it continues where it ended."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from hdplan.planner.studies.report import markdown_text

SAVED_EVERY = 20  # changes


class Tally:
    """How often each kind of change came out in each way."""

    def __init__(self, seed: int, file: Path | None) -> None:
        """Begin, or go on with what a file has of the same seed."""
        self.seed, self.file, self.done, self.found = seed, file, 0, dict[str, Counter[str]]()
        if file is not None and file.is_file():
            record = json.loads(file.read_text())
            if record["seed"] != seed:
                raise SystemExit(f"{file}: is of the seed {record['seed']}, not {seed}")
            self.done = record["done"]
            self.found = {kind: Counter(each) for kind, each in record["found"].items()}

    def numbers(self, count: int) -> Iterator[int]:
        """Yield the numbers of the changes that are still to be made; what one brings is saved when the next begins."""
        while self.done < count:
            yield self.done
            self.done += 1
            if self.done % SAVED_EVERY == 0 or self.done == count:
                self.save()

    def add(self, kind: str, outcome: str) -> None:
        """Count the outcome of a change."""
        self.found.setdefault(kind, Counter())[outcome] += 1

    def save(self) -> None:
        """Write the file, whole or not at all."""
        if self.file is not None:
            begun = self.file.with_name(f".{self.file.name}.part")
            begun.write_text(json.dumps({"seed": self.seed, "done": self.done, "found": self.found}))
            begun.replace(self.file)

    def table(self, columns: tuple[str, ...]) -> str:
        """Markdown: a row per kind of change, and one for all."""
        rows = {**self.found, "all": sum(self.found.values(), Counter[str]())}
        return markdown_text(
            [{"changed": kind, "changes": x.total(), **{c: x[c] for c in columns}} for kind, x in rows.items()]
        )
