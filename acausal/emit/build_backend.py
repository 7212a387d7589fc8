"""setuptools, and the runtime's libraries built before a wheel or an editable installation is made.

Where no compiler is found, ziglang from PyPI is asked for. Where that is not to be had either (without a network, without build isolation), or
a compiler fails, the package installs without libraries, and says so: the first compiler that is found later builds them. Wheels without
libraries are the same for all platforms. Processors other than x86-64 get one library of two lanes: that is compiled, but has never run.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from library import BUILT, FLAGS, SOURCES, Variant, compiler_at_hand, sources_hash, variants  # type: ignore[import-not-found]  # beside this file, see pyproject.toml
from setuptools import build_meta
from setuptools.command.bdist_wheel import bdist_wheel  # pyright: ignore[reportMissingModuleSource]  # of the build's own setuptools

_Settings = dict[str, Any] | None
build_sdist = build_meta.build_sdist
get_requires_for_build_sdist = build_meta.get_requires_for_build_sdist
prepare_metadata_for_build_editable = build_meta.prepare_metadata_for_build_editable
prepare_metadata_for_build_wheel = build_meta.prepare_metadata_for_build_wheel


class PlatformWheel(bdist_wheel):
    """A wheel for this platform and any Python 3: its libraries know nothing of Python."""

    def finalize_options(self) -> None:
        super().finalize_options()
        self.root_is_pure = not _built()

    def get_tag(self) -> tuple[str, str, str]:
        return "py3", "none", super().get_tag()[2]


def get_requires_for_build_wheel(config_settings: _Settings = None) -> list[str]:
    """See PEP 517."""
    return build_meta.get_requires_for_build_wheel(config_settings) + _compiler_from_pypi()


def get_requires_for_build_editable(config_settings: _Settings = None) -> list[str]:
    """See PEP 660."""
    return build_meta.get_requires_for_build_editable(config_settings) + _compiler_from_pypi()


def build_wheel(wheel_directory: str, config_settings: _Settings = None, metadata_directory: str | None = None) -> str:
    """See PEP 517."""
    build_libraries()
    return build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory: str, config_settings: _Settings = None, metadata_directory: str | None = None) -> str:
    """See PEP 660."""
    build_libraries()
    return build_meta.build_editable(wheel_directory, config_settings, metadata_directory)


def build_libraries() -> None:
    """The libraries of all variants that the compiler can build."""
    for old in _built():
        if not old.name.startswith(sources_hash()):
            old.unlink()
    command = compiler_at_hand()
    if command is None:
        print("acausal: no C compiler was found; its runtime is built when one is there.", file=sys.stderr)
        return
    BUILT.mkdir(exist_ok=True)
    for variant in variants():
        _build(variant, command)


def _built() -> list[Path]:
    """What is in the folder of libraries."""
    return [*BUILT.iterdir()] if BUILT.exists() else []


def _build(variant: Variant, command: tuple[str, ...]) -> None:
    with tempfile.TemporaryDirectory(dir=BUILT) as folder:
        made = Path(folder) / variant.file.name
        options = [*variant.flags(command), *FLAGS, f"-DLANES={variant.lanes}", "-shared", "-o", str(made)]
        result = subprocess.run(
            [*command, *options, str(SOURCES / "runtime.c"), "-lm"], capture_output=True, text=True, check=False
        )
        if result.returncode == 0:
            os.replace(made, variant.file)
        else:
            print(
                f"acausal: its runtime cannot be built for {variant.architecture or 'this machine'}:\n{result.stderr[-2000:]}",
                file=sys.stderr,
            )


def _compiler_from_pypi() -> list[str]:
    return [] if compiler_at_hand() else ["ziglang>=0.13"]
