"""How the pages are made: `make docs`."""

from __future__ import annotations

import sys
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

project = "acausal"
author = "the authors of acausal"
copyright = "the authors, MIT licence"
extensions = ["myst_parser", "sphinx_design", "tools.mathml", "tools.run"]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
highlight_language = "text"  # of what names no language: messages, formulas
html_math_renderer = "mathml"
html_theme = "furo"
html_title = "acausal"
html_static_path = ["static"]
html_css_files = ["page.css"]
html_copy_source = False
html_show_sphinx = False
exclude_patterns = ["_build", "tools", "scenes", "own"]
nitpicky = True
suppress_warnings = ["toc.not_included", "toc.duplicate_entry"]  # a page that no menu names is found by the search


def setup(app: Sphinx) -> None:
    """Called by Sphinx: pages that are made from code are made before it reads any."""
    app.add_config_value("keep_generated", False, "env", bool)
    app.connect("builder-inited", _generate)
    app.connect("build-finished", _check)


def _generate(app: Sphinx) -> None:
    from tools import gallery, parts, systems

    if app.config.keep_generated:  # -D keep_generated=1, while one writes the other pages
        return
    parts.write_pages(HERE / "parts")
    machines = gallery.write_pages(HERE / "gallery", HERE / "static" / "gallery")
    systems.write_page(HERE / "systems.md", machines)


def _check(app: Sphinx, error: Exception | None) -> None:
    from tools.offline import check_offline

    if error is None:
        check_offline(Path(app.outdir))
