"""A directive for code that is run while a page is made: the code, what it prints, and a picture that it draws.

    ```{run}
    :picture: four_bar.png
    print(model)
    run.picture("four_bar.png")
    ```

Blocks of one page share their names, as in one script. A block that raises fails the build, unless it says `:raises: NameOfTheError`: then the message is shown.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from tools.executed import executed

_SPACES: dict[str, dict[str, Any]] = {}


class Run(SphinxDirective):
    """See above."""

    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {
        "picture": directives.unchanged,
        "raises": directives.unchanged,
        "hidden": directives.flag,
    }

    def run(self) -> list[nodes.Node]:
        """Called by docutils."""
        code = "\n".join(self.content)
        drawn = self.options.get("picture")
        picture = self._place() / drawn if drawn else None
        printed = executed(code, _SPACES.setdefault(self.env.docname, {}), drawn, picture, self.options.get("raises"))
        found: list[nodes.Node] = [] if "hidden" in self.options else [nodes.literal_block(code, code, language="python")]
        if printed:
            found.append(nodes.literal_block(printed, printed, language="text", classes=["printed"]))
        if picture is not None:
            found.append(nodes.image(uri="/" + picture.relative_to(self.env.srcdir).as_posix(), alt=drawn, width="60%"))
        return found

    def _place(self) -> Path:
        folder = Path(self.env.srcdir) / "static" / "run"
        folder.mkdir(parents=True, exist_ok=True)
        return folder


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("run", Run)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
