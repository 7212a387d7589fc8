"""Every kind of part that the catalogue and the package hold, for tests of what holds for all of a kind."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Mapping
from typing import TypeVar

import components

Kind = TypeVar("Kind")


def kinds(base: type[Kind], other_than: type | tuple[type, ...] | None = None) -> list[type[Kind]]:
    """All final classes derived from `base`, but for those derived from `other_than`, by name."""
    for module in pkgutil.walk_packages(components.__path__, "components."):
        importlib.import_module(module.name)
    found: list[type[Kind]] = []
    queue: list[type[Kind]] = [base]
    while queue:
        cls = queue.pop()
        queue += [sub for sub in cls.__subclasses__() if other_than is None or not issubclass(sub, other_than)]
        public = not inspect.isabstract(cls) and not cls.__name__.startswith("Abstract")
        if public and cls.__module__.startswith(("components", "acausal")):
            found.append(cls)
    return sorted(found, key=lambda cls: cls.__name__)


def made(cls: type[Kind], arguments: Mapping[str, object]) -> Kind:
    """An instance, with those of the `arguments` that have no default."""
    given = inspect.signature(cls).parameters.items()
    wanted = [n for n, p in given if p.default is p.empty and p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    return cls(**{n: arguments[n] for n in wanted})
