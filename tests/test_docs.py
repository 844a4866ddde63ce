"""README and docs against the code: every key of a scenario is explained, every command parses, every path exists."""

from __future__ import annotations

import argparse
import dataclasses
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
import yaml
from doc_blocks import EXCERPTS, Block, blocks
from doc_blocks import PAGES as BLOCK_PAGES

from apad_bridge.commands.main import all_groups, parser
from apad_bridge.runs.exits import EXITS, Exit
from apad_bridge.scenario.schema import Scenario

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").glob("*.md")),
]
ROOMS = ("launch_scripts", "docs", "apad_bridge", "agents", "firmware_model", "tests", "benchmarks")


def dataclasses_in(kind: Any) -> Iterator[type]:
    """The dataclass that a type is, or holds in a union or tuple, and those of its fields, depth first."""
    for part in get_args(kind):
        yield from dataclasses_in(part)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        yield kind
        for hint in get_type_hints(kind).values():
            yield from dataclasses_in(hint)


LONGEST_SENTENCE = 35
"""Words; a span of code counts as one, and a link as its text."""


def paragraphs(text: str) -> Iterator[tuple[int, str]]:
    """(line, text) of each paragraph and list item: no code block, table, heading or picture."""
    lines: list[str] = []
    begun, is_code = 0, False
    for number, line in enumerate([*text.splitlines(), ""], start=1):
        is_fence = line.lstrip().startswith("```")
        is_code ^= is_fence
        is_indented_code = line.startswith("    ") and not lines
        is_prose = not (is_code or is_fence or is_indented_code) and not re.match(r"\s*(?:$|[|#<!])", line)
        is_item = re.match(r"\s*(?:[-*]|\d+\.) ", line) is not None
        if lines and (is_item or not is_prose):
            yield begun, " ".join(lines)
            lines = []
        if is_prose:
            begun = begun if lines else number
            lines.append(re.sub(r"^\s*(?:[-*]|\d+\.) ", "", line).strip())


def long_sentences(text: str) -> list[tuple[int, int, str]]:
    """(line of its paragraph, words, sentence) of each sentence in the text that is longer than `LONGEST_SENTENCE`."""
    found = []
    for line, paragraph in paragraphs(text):
        plain = re.sub(r"`[^`]*`", "CODE", paragraph)
        plain = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", plain)
        for sentence in re.split(r"(?<!\bFig\.)(?<!\be\.g\.)(?<!\bi\.e\.)(?<=[.!?])[\"')*]*\s+", plain):
            if (words := len(sentence.split())) > LONGEST_SENTENCE:
                found.append((line, words, sentence))
    return found


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
        parser(arguments).parse_args(arguments)
    except SystemExit as ended:
        assert ended.code == 0, f"{page}: {command}: {capsys.readouterr().err}"
    for path in words:
        assert not path.startswith(ROOMS) or (ROOT / path).exists()


def parsers(of: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    yield of
    for action in of._actions:
        if isinstance(action, argparse._SubParsersAction):
            for each in action.choices.values():
                yield from parsers(each)


PARSERS = [parser()]
PARSERS += {
    each.prog: each
    for name in chain.from_iterable(all_groups().values())
    for each in parsers(parser([name]))
    if each.prog != "musselbed"
}.values()


@pytest.mark.parametrize("each", PARSERS, ids=lambda each: each.prog)
def test_every_help_ends_with_two_commands_that_parse(each: argparse.ArgumentParser) -> None:
    lines = each.format_help().splitlines()
    examples = [line.strip() for line in lines if line.startswith("  musselbed ")]
    assert len(examples) >= 2
    for example in examples:
        assert example.startswith(each.prog)
        words = shlex.split(example.partition(" > ")[0])[1:]
        parser(words).parse_args(words)
        for path in words:
            assert not path.startswith(ROOMS) or (ROOT / path).exists(), example


@pytest.mark.parametrize("each", PARSERS, ids=lambda each: each.prog)
def test_no_sentence_of_a_help_is_long(each: argparse.ArgumentParser) -> None:
    texts = [each.description or "", *(action.help or "" for action in each._actions)]
    assert [found for text in texts for found in long_sentences(text)] == []


def test_commands_are_found_at_all() -> None:
    found = [command for _, command in commands()]
    for name in ("run", "resume", "fleet", "mission", "replay", "doctor"):
        assert any(command.startswith(f"musselbed {name}") for command in found)


@pytest.mark.parametrize(
    ("page", "path"), sorted(set(of_all_pages(rf"\b((?:{'|'.join(ROOMS)})/[\w./-]*\w)")))
)
def test_every_path_exists(page: str, path: str) -> None:
    assert (ROOT / path).exists(), f"{page} names {path}"


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as Git's web pages and Sphinx make them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize(("page", "target"), sorted(set(of_all_pages(r"\]\((?!https?:)([^)]+)\)"))))
def test_every_link_leads_somewhere(page: str, target: str) -> None:
    name, _, anchor = target.partition("#")
    linked = (ROOT / page).parent / name if name else ROOT / page
    assert linked.is_file()
    assert not anchor or anchor in anchors(linked)


def words(page: Path) -> int:
    """The words of a page, without its comments."""
    return len(re.sub(r"<!--.*?-->", "", page.read_text(), flags=re.DOTALL).split())


def test_the_readme_has_600_words_at_most() -> None:
    assert words(ROOT / "README.md") <= 600


TABLES = ("records.md", "scenarios.md", "studies-results.md")
"""Pages that are tables to look things up in."""


def test_the_guide_to_studies_has_2500_words_at_most() -> None:
    assert words(ROOT / "docs" / "studies.md") <= 2500


@pytest.mark.slow
def test_the_page_of_results_is_what_the_archived_studies_give() -> None:
    make = [sys.executable, ROOT / "docs/results/make", "--check"]
    done = subprocess.run(make, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "page", [it for it in PAGES[2:] if it.name not in TABLES], ids=lambda page: page.name
)
def test_a_page_that_is_no_table_has_4000_words_at_most(page: Path) -> None:
    assert words(page) <= 4000


def test_the_index_lists_every_page_once_in_one_of_four_groups() -> None:
    index = ROOT / "docs" / "README.md"
    listed = re.findall(r"^- \[[^\]]+\]\(([^)]+)\): \S", index.read_text(), re.MULTILINE)
    pages = [page.name for page in index.parent.glob("*.md") if page != index]
    whole = [link for link in listed if "#" not in link]
    assert sorted(whole) == sorted(pages), "add a line for the page to a group of docs/README.md"
    assert re.findall(r"^## (.*)$", index.read_text(), re.MULTILINE) == [
        "Tutorials",
        "How-to guides",
        "Reference",
        "Explanation",
    ]


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_leads_to_every_page(tmp_path: Path) -> None:
    pytest.importorskip("furo")
    build = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", ROOT / "docs", tmp_path]
    built = subprocess.run(build, capture_output=True, text=True, timeout=300)
    assert built.returncode == 0, built.stderr
    index = (tmp_path / "README.html").read_text()
    for page in (ROOT / "docs").glob("*.md"):
        assert f'href="{page.stem}.html"' in index or page.name == "README.md"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_sentence_is_long(page: Path) -> None:
    offenders = [
        f"{page.name}:{line}: {words} words: {text}" for line, words, text in long_sentences(page.read_text())
    ]
    assert not offenders, "\n".join(offenders)


def test_a_long_sentence_is_found_in_prose_and_lists_and_nowhere_else() -> None:
    long = " ".join(["word"] * LONGEST_SENTENCE)
    short = f"`a b c` {long[5:]}."
    page = f"# {long} x\n\n| {long} x |\n\n```\n{long} x\n```\n\n    {long} x\n\n{short} {short}\n{short}\n"
    assert long_sentences(page) == []
    wrapped = long.replace(" ", "\n", 1)
    assert [
        it[:2] for it in long_sentences(f"{page}\n{wrapped} x. {short}\n\n1. {long}\n   x.\n- Short.\n")
    ] == [
        (14, LONGEST_SENTENCE + 1),
        (17, LONGEST_SENTENCE + 1),
    ]


def test_launch_commands_name_launch_files() -> None:
    named = of_all_pages(r"roslaunch musselbed (\S+\.launch)")
    assert named
    for page, name in named:
        assert (ROOT / "launch_scripts" / name).exists(), page


BLOCKS = [block for page in BLOCK_PAGES for block in blocks(page)]


@pytest.mark.parametrize("block", BLOCKS, ids=str)
def test_every_block_of_code_has_a_mark_or_is_an_excerpt(block: Block) -> None:
    match block.mark:
        case "run" | "run beside a flight":
            assert block.kind in ("sh", "python")
        case "file" | "not run":
            assert block.argument
        case "tested":
            test = (ROOT / block.argument).read_text()
            orders = re.findall(
                r"^(?:musselbed|python) (\w+)|^(rosservice|roslaunch|ROS_NAMESPACE)", block.text, re.M
            )
            assert block.page.name in test or all(
                any(word in test for word in order if word) for order in orders
            )
        case "":
            assert block.kind in EXCERPTS, "mark the block: tests/shared/doc_blocks.py lists the marks"
        case _:
            raise AssertionError(f"no such mark: {block.mark}")


def test_marks_belong_to_the_block_that_follows(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    marked = "<!-- run: --seeds 2 -->\n    one\n\n    two\n\n<!-- run -->\nText.\n\n```python\nx\n```\n"
    page.write_text(f"Text\n    that continues.\n\n{marked}")
    found = [(block.kind, block.text, block.mark, block.argument, block.line) for block in blocks(page)]
    assert found == [("sh", "one\n\ntwo\n", "run", "--seeds 2", 5), ("python", "x\n", "", "", 13)]


def test_the_page_of_commands_has_every_command_and_no_other() -> None:
    page = (ROOT / "docs" / "commands.md").read_text()
    table = "\n".join(re.findall(r"^\| (.*?) \|", page.partition("## Exit codes")[0], re.MULTILINE))
    first = {each.prog.split()[1] for each in PARSERS if len(each.prog.split()) > 1}
    assert set(re.findall(r"`(?:musselbed )?([a-z][\w-]*)[ `]", table)) == first


def test_the_page_of_commands_has_the_exit_codes_of_every_help() -> None:
    page = (ROOT / "docs" / "commands.md").read_text()
    rows = dict(re.findall(r"^\| (\d+) \| (.*) \|$", page, re.MULTILINE))
    assert {int(code) for code in rows} == {int(code) for code in Exit}
    for code, meaning in rows.items():
        words = re.split(r"[:,(]", meaning)[0].strip()
        assert f"{code} {words}" in EXITS


@pytest.mark.parametrize("room", ["apad_bridge", "agents", "firmware_model", "benchmarks", "tests/campaigns"])
def test_no_docstring_begins_with_a_clause(room: str) -> None:
    clause = re.compile(r'^\s*"""(?:What|Of|Whether|Who|That|Where|How|As|To) ', re.MULTILINE)
    assert [
        str(path) for path in sorted((ROOT / room).rglob("*.py")) if clause.search(path.read_text())
    ] == []


@pytest.mark.slow
def test_each_hook_before_a_commit_has_a_program_that_finds_tests_or_takes_each_file_of_ours() -> None:
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True)
    for hook in hooks:
        words = shlex.split(hook["entry"])
        program = Path(sys.executable).with_name(Path(words[0]).name)
        assert program.exists(), words
        # A commit of any file is given to it by name, whatever the linters leave out by themselves.
        given = [it for it in listed.stdout.split("\0") if re.search(hook["files"], it)]
        arguments = ["--collect-only"] if "pytest" in words else given
        done = subprocess.run([program, *words[1:], *arguments], cwd=ROOT, capture_output=True, text=True)
        assert given and done.returncode == 0, done.stdout[-500:]


def test_the_road_of_a_status_packet_has_18_files_and_9_forms_at_most() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text()
    _, _, road = page.partition("### The road of a status packet to a docking order\n")
    steps = re.findall(r"^\d+\. .*(?:\n    .*)*", road.partition("\n### ")[0], re.MULTILINE)
    forms = {form for step in steps for form in re.findall(r"`([A-Z]\w+)(?:\[\w+\])?`", step)}
    code = [path.read_text() for room in ROOMS[2:5] for path in (ROOT / room).rglob("*.py")]
    assert all(any(re.search(rf"^class {form}\b", text, re.MULTILINE) for text in code) for form in forms)
    assert 0 < len(steps) <= 18 and 0 < len(forms) <= 9
