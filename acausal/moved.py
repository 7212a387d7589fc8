"""Old module names, which answer for one version with a warning: `acausal.mechanics.joint` is `acausal.parts.joint` now."""

from __future__ import annotations

import importlib
import importlib.machinery
import importlib.util
import sys
import warnings
from collections.abc import Sequence
from types import ModuleType
from typing import Any, cast, final

_PARTS = (
    "constraint",
    "elastic_body",
    "force",
    "free",
    "inertia",
    "joint",
    "modal_inertia",
    "motion",
    "pose",
    "rigid",
    "sketch",
    "steps",
)
_PACKAGES = {"acausal.mechanics": "acausal.parts", "acausal.codegen": "acausal.emit"}
_RENAMED = {
    **_PACKAGES,
    **{f"acausal.mechanics.{name}": f"acausal.parts.{name}" for name in _PARTS},
    "acausal.mechanics.placement": "acausal.parts.placement",
    "acausal.simulation": "acausal.simulate.simulation",
    "acausal.trajectory": "acausal.simulate.trajectory",
    "acausal.events": "acausal.simulate.events",
    "acausal.sensitivity": "acausal.simulate.sensitivity",
    "acausal.charts.minimal": "acausal.minimal.model",
    "acausal.codegen.compiler": "acausal.emit.compiler",
    "acausal.codegen.emit": "acausal.emit.emit",
    "acausal.codegen.lower": "acausal.outputs.functions",
}


@final
class _OldNames:
    """Finds modules by names that they had in the last version. A finder and loader by its methods: `importlib.abc` takes long to import."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname not in _RENAMED:
            return None
        return importlib.util.spec_from_loader(fullname, cast(Any, self), is_package=fullname in _PACKAGES)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        new = _RENAMED[spec.name]
        if spec.name not in _PACKAGES:  # whoever imports from one is told by the module within
            warnings.warn(f"{spec.name} is {new} now; the old name goes with the next version.", DeprecationWarning, stacklevel=2)
        found = importlib.import_module(new)
        answer = ModuleType(spec.name, found.__doc__)
        answer.__dict__.update({key: value for key, value in vars(found).items() if not key.startswith("__")})
        return answer

    def exec_module(self, module: ModuleType) -> None:
        """The names are there already."""


def answer_to_old_names() -> None:
    """Let old module names be imported in this process."""
    if not any(isinstance(finder, _OldNames) for finder in sys.meta_path):
        sys.meta_path.append(_OldNames())
