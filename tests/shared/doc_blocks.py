"""The code blocks of README and docs, each with its mark: an HTML comment on a line before the block.

No renderer shows such a comment. The marks are:

- `<!-- run -->`: a shell or Python runs the block. With `<!-- run: OPTIONS -->` the options follow its last command, to
  make it short; `<!-- run beside a flight -->` runs it while a run flies, whose directory stands for `RUN`.
- `<!-- file: NAME -->`: the reader saves the block as this file, which later blocks of the page use.
- `<!-- tested: PATH -->`: the test at this path runs the block.
- `<!-- not run: REASON -->`: no test can run the block, or none should.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from shutil import copy2

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
EXCERPTS = ("text", "yaml", "xml", "ini", "toml", "diff", "json", "mermaid")
"""Kinds of fenced blocks that may have no mark: parts of a file, and output."""


def file_of(page: Path, name: str) -> str:
    """The text of the block that the reader saves under this name."""
    found = [block.text for block in blocks(page) if (block.mark, block.argument) == ("file", name)]
    assert len(found) == 1, f"{page.name} shows {name} {len(found)} times"
    return found[0]


TEMPLATES = ROOT / "launch_scripts/templates"


def install_template(site: Path, kind: str) -> None:
    """Writes the package of a template, as `codec`, as pip leaves it behind."""
    project = tomllib.loads((TEMPLATES / kind / "pyproject.toml").read_text())["project"]
    name, version = project["name"], project["version"]
    info = site / f"{name}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    ((group, parts),) = project["entry-points"].items()
    entries = "".join(f"{it} = {where}\n" for it, where in parts.items())
    (info / "entry_points.txt").write_text(f"[{group}]\n{entries}")
    for module in (TEMPLATES / kind).glob("*.py"):
        copy2(module, site)


@dataclass(frozen=True)
class Block:
    page: Path
    line: int
    """The line of its first line of code in the page, counted from 1."""
    kind: str
    """The language of a fenced block; `sh` for an indented one."""
    text: str
    mark: str
    """`run`, `run beside a flight`, `file`, `tested`, `not run`, or nothing."""
    argument: str
    """The text after the mark's colon."""

    def __str__(self) -> str:
        return f"{self.page.name}:{self.line}"


def blocks(page: Path) -> Iterator[Block]:
    """The page's blocks from the top on."""
    lines = page.read_text().splitlines()
    number = 0
    mark = argument = ""
    while number < len(lines):
        line = lines[number]
        number += 1
        if found := re.fullmatch(r"<!-- ([a-z ]+?)(?:: (.*?))? -->", line):
            mark, argument = found[1], found[2] or ""
            continue
        begun, kind = number, ""
        if fence := re.fullmatch(r"```(\w*)", line):
            kind, begun = fence[1] or "text", number + 1
            ended = next(at for at in range(number, len(lines)) if lines[at] == "```")
            text, number = lines[number:ended], ended + 1
        elif line.startswith("    ") and (begun == 1 or not lines[begun - 2].strip() or mark):
            kind = "sh"
            while number < len(lines) and (lines[number].startswith("    ") or not lines[number].strip()):
                number += 1
            text = [each[4:] for each in lines[begun - 1 : number]]
        if kind:
            yield Block(page, begun, kind, "\n".join(text).rstrip() + "\n", mark, argument)
        if line.strip():
            mark = argument = ""
