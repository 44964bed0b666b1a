"""The common part of all stages of a job: a name, what may touch in it, limits, and its share of the speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

from hdplan.scenes.errors import FieldError
from hdplan.scenes.limits import Limits
from hdplan.scenes.values import Checked, Name, Number, Row, is_row, text, wrong

Touch = tuple[tuple[str, str], ...]
AnyTouch = Sequence[Sequence[str | Sequence[str]]]


def touching(value: object) -> Touch:
    """Return pairs of names that may touch, each given as ``[one, other]`` or ``[one, [other, ..]]``."""
    found: dict[tuple[str, str], None] = {}
    for i, entry in enumerate(Row(_as_it_is, of="pairs")(value)):
        if not is_row(entry) or len(entry) != 2:
            raise wrong("two names that may touch, the second maybe a list of them", entry).within(f"[{i}]")
        try:
            one = text(entry[0])
            others = Row(text, of="names")(entry[1]) if is_row(entry[1]) else (text(entry[1]),)
            if one in others:
                raise FieldError(f"must name two different bodies, found {one!r} twice")
        except FieldError as error:
            raise error.within(f"[{i}]") from None
        found |= dict.fromkeys((one, other) for other in others)
    return tuple(found)


def _as_it_is(value: object) -> object:
    return value


@dataclass(frozen=True, repr=False)
class AnyStage(Checked):
    """Common part of every stage."""

    name: Name | None = field(default=None, kw_only=True)  # in messages and marks; None: its kind and number
    touch: Annotated[Touch, touching] = field(default=(), kw_only=True)
    """Pairs of names that may touch in this stage alone: links, held objects, obstacles."""
    limits: Limits | None = field(default=None, kw_only=True)  # in this stage; None: the scene's
    speed: Annotated[float, Number(high=1.0, above=0.0)] = field(default=1.0, kw_only=True)
    """Share of the speed that the limits allow."""

    @property
    def kind(self) -> str:
        """Key in a file: "move"."""
        return type(self).__name__.lower()


@dataclass(frozen=True, repr=False)
class ArmStage(AnyStage):
    """Common part of every stage that moves the arm."""

    blend: Annotated[float, Number(high=1.0, low=0.0, unit="m")] = field(default=0.0, kw_only=True)
    """Radius around its end within which it passes into the next stage without a stop [m]; 0: it ends at rest."""
