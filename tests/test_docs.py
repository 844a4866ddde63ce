"""README and docs against the code: every key of a scenario is explained, every command parses, every path exists."""

from __future__ import annotations

import dataclasses
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from apad_bridge.commands.main import parser
from apad_bridge.scenario.schema import Scenario

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
ROOMS = ("launch_scripts", "docs", "apad_bridge", "agents", "firmware_model", "tests", "benchmarks")


def dataclasses_in(kind: Any) -> Iterator[type]:
    """The dataclass that a type is, or holds in a union or tuple, and those of its fields, depth first."""
    for part in get_args(kind):
        yield from dataclasses_in(part)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        yield kind
        for hint in get_type_hints(kind).values():
            yield from dataclasses_in(hint)


DATACLASSES = list(dict.fromkeys(dataclasses_in(Scenario)))


def of_all_pages(pattern: str) -> list[tuple[str, str]]:
    """(page, first group) of every match in the pages."""
    return [
        (str(page.relative_to(ROOT)), found[1])
        for page in PAGES
        for found in re.finditer(pattern, page.read_text(), re.MULTILINE)
    ]


def commands() -> Iterator[tuple[str, str]]:
    """Lines of code blocks and pieces between backticks that begin with `musselbed`."""
    yield from of_all_pages(r"^    (musselbed .*)$")
    yield from of_all_pages(r"`(musselbed [^`]+)`")


@pytest.mark.parametrize("kind", DATACLASSES, ids=lambda kind: kind.__name__)
def test_every_key_of_a_scenario_is_explained(kind: type) -> None:
    page = (ROOT / "docs" / "scenarios.md").read_text()
    missing = [
        field.name
        for field in dataclasses.fields(kind)
        if f"| `{field.name}` |" not in page and f"\n## {field.name}\n" not in page
    ]
    assert missing == []


def test_no_key_is_explained_that_is_not_there() -> None:
    keys = re.findall(r"^\| `(\w+)` \|", (ROOT / "docs" / "scenarios.md").read_text(), re.MULTILINE)
    known = {field.name for kind in DATACLASSES for field in dataclasses.fields(kind)}
    assert set(keys) - known == set()
    assert len(keys) > 50


@pytest.mark.parametrize(("page", "command"), sorted(set(commands())))
def test_every_command_parses(page: str, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    _, *words = shlex.split(command.replace("[", "").replace("]", ""), comments=True)
    arguments = [*words, "--help"] if len(words) == 1 else words
    try:
        parser().parse_args(arguments)
    except SystemExit as ended:
        assert ended.code == 0, f"{page}: {command}: {capsys.readouterr().err}"
    if (scenario := next((word for word in words if "/" in word), None)) is not None:
        assert (ROOT / scenario).exists()


def test_commands_are_found_at_all() -> None:
    found = [command for _, command in commands()]
    for name in ("run", "resume", "fleet", "mission", "replay", "doctor"):
        assert any(command.startswith(f"musselbed {name}") for command in found)


@pytest.mark.parametrize(
    ("page", "path"), sorted(set(of_all_pages(rf"\b((?:{'|'.join(ROOMS)})/[\w./-]*\w)")))
)
def test_every_path_exists(page: str, path: str) -> None:
    assert (ROOT / path).exists(), f"{page} names {path}"


@pytest.mark.parametrize(("page", "target"), sorted(set(of_all_pages(r"\]\((?!http)([^)]+)\)"))))
def test_every_link_leads_somewhere(page: str, target: str) -> None:
    name, _, anchor = target.partition("#")
    linked = (ROOT / page).parent / name
    assert linked.exists()
    if anchor:
        headings = re.findall(r"^#+ (.*)$", linked.read_text(), re.MULTILINE)
        assert anchor in {heading.lower().replace(" ", "-") for heading in headings}


def test_launch_commands_name_launch_files() -> None:
    named = of_all_pages(r"roslaunch musselbed (\S+\.launch)")
    assert named
    for page, name in named:
        assert (ROOT / "launch_scripts" / name).exists(), page
