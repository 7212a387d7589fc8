"""How the runtime becomes a library, whoever builds it: the package (see build_backend.py), or a process that finds none that fits.

It imports nothing beside Python's own modules, since it is needed before anything is installed.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

SOURCES = Path(__file__).resolve().parent.parent / "runtime"
"""Folder of the C sources that come with the package."""
BUILT = SOURCES / "built"
"""Folder of libraries that are built with the package."""
FLAGS = ("-O2", "-fPIC", "-fno-math-errno", "-ffp-contract=off", "-Wno-psabi", "-fvisibility=hidden")
"""-O2 and not -O1: only then does gcc clear the upper halves of vector registers before it calls the C library. Without that each such
call stalls on Intel processors (`python -m benchmarks.compiler_flags` measures it)."""


@dataclass(frozen=True)
class Variant:
    """A kind of processor: what compilers call it, and how many lanes its registers have."""

    architecture: str
    lanes: int

    def flags(self, command: tuple[str, ...]) -> tuple[str, ...]:
        """Compiler options; zig spells them in its own way."""
        if not self.architecture:
            return ()
        return (f"-march={self.architecture.replace('-', '_') if 'ziglang' in command else self.architecture}",)

    @property
    def file(self) -> Path:
        """Where the package keeps its library, under a name that changes with the sources: an edited header never runs an old library."""
        return BUILT / f"{sources_hash()}-{self.architecture or 'any'}-{self.lanes}{suffix()}"


def variants() -> tuple[Variant, ...]:
    """The kinds of processors that a library is built for on this machine, the plainest first."""
    if platform.machine().lower() in ("x86_64", "amd64"):
        return Variant("x86-64-v2", 2), Variant("x86-64-v3", 4), Variant("x86-64-v4", 8)
    return (Variant("", 2),)


@functools.cache
def sources() -> dict[str, bytes]:
    """The C sources by name, read once in a process: what is hashed is what is compiled, even while somebody edits them."""
    return {file.name: file.read_bytes() for file in sorted(SOURCES.glob("*.[ch]"))}


def sources_hash() -> str:
    """Of everything that the library is made from."""
    parts = {**sources(), Path(__file__).name: Path(__file__).read_bytes()}
    return hashlib.sha256(b"\0".join(name.encode() + content for name, content in parts.items())).hexdigest()[:24]


def compiler_at_hand() -> tuple[str, ...] | None:
    """The C compiler that is used: $CC, cc, gcc, clang, or ziglang from PyPI; None if there is none."""
    for name in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        words = shlex.split(name)
        if words and shutil.which(words[0]):
            return tuple(words)
    return (sys.executable, "-m", "ziglang", "cc") if _has_ziglang() else None


def _has_ziglang() -> bool:
    try:
        return importlib.util.find_spec("ziglang") is not None
    except ValueError:  # a module without a specification
        return True


def suffix() -> str:
    """.so, .dylib or .dll."""
    return ".dll" if sys.platform == "win32" else ".dylib" if sys.platform == "darwin" else ".so"
