"""What there is to write pages about: every public class of `components`, found and not listed."""

from __future__ import annotations

import inspect
import re
from dataclasses import dataclass

import components
from acausal.language.component import Component
from acausal.parts.joint import AbstractJoint

_TITLES = {
    "world": "Bodies",
    "bodies": "Bodies",
    "flexible": "Elastic bodies",
    "flexible_beam": "Elastic bodies",
    "joints": "Joints",
    "guides": "Guides",
    "geometry": "Curves and surfaces",
    "contacts": "Contacts",
    "forces": "Forces",
    "fields": "Fields",
    "earth": "Fields",
    "gears": "Shafts",
    "cam": "Shafts",
    "rotational": "Shafts",
    "translational": "Lines",
    "electrical": "Circuits",
    "amplifier": "Circuits",
    "motor": "Circuits",
    "robot": "Robots",
    "signals": "Signals",
    "sensors": "Signals",
}


@dataclass(frozen=True)
class Kind:
    """A class of the catalogue by its public name; its docstring as text and, below it, the lines of code that show how it is made."""

    name: str
    cls: type
    text: str
    example: str

    @property
    def group(self) -> str:
        """Title of the chapter: by the module that it stands in, or that module's own name where it is new."""
        home, room = self.cls.__module__.split(".")[:2]
        if home == "acausal":
            return "Joints" if issubclass(self.cls, AbstractJoint) else "Elastic bodies"
        return _TITLES.get(room, room.replace("_", " ").capitalize())

    @property
    def summary(self) -> str:
        """First sentence of the docstring."""
        paragraph = " ".join(self.text.split("\n\n")[0].split())
        return re.split(r"(?<=[a-z0-9)\]`])\.\s", paragraph)[0].rstrip(".") + "."

    @property
    def is_part(self) -> bool:
        """Whether it stands in a scene by itself; curves, surfaces and sections belong to a part."""
        return issubclass(self.cls, Component)


def catalogue() -> list[Kind]:
    """All kinds, in the order of their chapters, then by name."""
    classes = {name: value for name in components.__all__ if inspect.isclass(value := getattr(components, name))}
    kinds = [Kind(name, cls, *split_docstring(inspect.getdoc(cls) or "")) for name, cls in classes.items()]
    chapters = list(dict.fromkeys(_TITLES.values()))
    return sorted(kinds, key=lambda k: (chapters.index(k.group) if k.group in chapters else len(chapters), k.group, k.name))


def split_docstring(text: str) -> tuple[str, str]:
    """Text, and the code at its end: the last paragraph where it is indented or begins with a name that code begins with."""
    paragraphs = text.split("\n\n")
    last = paragraphs[-1]
    if len(paragraphs) > 1 and re.match(r"\s{4}|scene\.|[A-Z]\w*\(", last):
        return "\n\n".join(paragraphs[:-1]), inspect.cleandoc(last)
    return text, ""
