"""Default classes of an MJCF: the values of attributes that an element omits."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree.ElementTree import Element

from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.robot_files.mjcf_words import called

MAIN = "main"  # the class of all that have no other

Values = dict[str, dict[str, str]]  # kind of element -> attribute -> value


class DefaultClasses:
    """The classes, each with what it inherits."""

    def __init__(self, sections: Iterable[Element]) -> None:
        """Read the `default` sections: several are one, and the first may give the main class a name of its own.

        Raises InputError for a class without a name, or one whose name is taken.
        """
        self._values: dict[str, Values] = {MAIN: {}}
        for section in sections:
            self._read(section, MAIN, self._values[MAIN])
            self._values[section.get("class", MAIN)] = self._values[MAIN]

    def _read(self, section: Element, name: str, above: Values) -> None:
        own = {kind: dict(values) for kind, values in above.items()}
        for element in section:
            if element.tag != "default":
                own[element.tag] = {**own.get(element.tag, {}), **element.attrib}
        self._values[name] = own
        for below in section.findall("default"):
            below_name = below.get("class")
            if not below_name:
                raise InputError("default: a class within another one must have a name: the attribute 'class'")
            if below_name in self._values:
                raise InputError(f"default: the class '{below_name}' is defined twice; names must differ")
            self._read(below, below_name, own)

    def check(self, name: str, where: str) -> str:
        """Return the name of a class. Raises InputError if there is none of this name."""
        if name not in self._values:
            raise InputError(f"{where}: unknown class '{name}'{nearest(name, self._values)}")
        return name

    def applied(self, element: Element, inherited: str = MAIN, kind: str | None = None) -> dict[str, str]:
        """Return an element's attributes, with those of its class, or else of the one that it inherits."""
        name = self.check(element.get("class", inherited), called(element))
        return {**self._values[name].get(kind or element.tag, {}), **element.attrib}
