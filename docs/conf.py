"""The settings of Sphinx for the site that launch_scripts/docs builds from these pages."""

from __future__ import annotations

import re
from typing import Any

from pygments.lexers.special import TextLexer

project = "musselbed"
extensions = ["myst_parser"]
root_doc = "README"
exclude_patterns = ["_build", "paper"]
# Light or dark as the system is, and usable on a phone.
html_theme = "furo"
html_title = "musselbed"
html_static_path = ["_static"]
html_css_files = ["phone.css"]
html_show_copyright = False
html_show_sphinx = False
# The depth of headings that a link can name, as `page.md#heading`.
myst_heading_anchors = 3


def _with_contents(_: Any, page: str, source: list[str]) -> None:
    """Adds a table of contents to each group of the index: its list of pages, which Sphinx needs in its own form."""
    if page != root_doc:
        return
    groups = re.split(r"^(?=## )", source[0], flags=re.MULTILINE)
    source[0] = "".join(map(_with_toctree, groups))


def _with_toctree(group: str) -> str:
    pages = re.findall(r"^- \[[^\]]*\]\(([\w/-]+)\.md\)", group, re.MULTILINE)
    if not pages:
        return group
    title = group.partition("\n")[0].removeprefix("## ")
    return "\n".join([group, "```{toctree}", ":hidden:", f":caption: {title}", "", *pages, "```", "", ""])


def setup(app: Any) -> None:
    app.connect("source-read", _with_contents)
    # A diagram in Mermaid is shown as its text: drawing it would need a program of a third party.
    app.add_lexer("mermaid", TextLexer)
