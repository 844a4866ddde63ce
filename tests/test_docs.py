"""README and docs against the code: every key of a scenario is explained, every command parses, every path exists."""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import re
import runpy
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
BY_HAND = sorted((ROOT / "docs").glob("*.md"))
MADE = sorted((ROOT / "docs/reference").glob("*.md"))
TABLES = ROOT / "docs/results/tables.md"
FRONT = [ROOT / f"{it}.md" for it in ("README", "CHANGELOG", "CONTRIBUTING", "SECURITY", "CODE_OF_CONDUCT")]
PAPER = ROOT / "docs/paper/paper.md"
PAGES = [*FRONT, *BY_HAND, *MADE, PAPER]
MAKE = runpy.run_path(str(ROOT / "docs/reference/make"))
"""The names of the command that makes the pages of docs/reference from the code."""
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
LONGEST_PAGE = 3000
MOST_WORDS = {
    "README.md": 600,
    "docs/studies.md": 2500,
    "docs/studies-results.md": 1500,
    "docs/paper/paper.md": 1000,
    "docs/beside-others.md": 900,
}
"""Of a page; `LONGEST_PAGE` for another one by hand in docs."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_is_right(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its commands parse, its paths and links lead somewhere, its blocks are marked, and it is short."""
    text = page.read_text()
    faults = list(faulty_links(page, text))
    faults += [
        f"{it}: mark the block: tests/shared/doc_blocks.py lists the marks"
        for it in (blocks(page) if page in BLOCK_PAGES else ())
        if not is_marked(it)
    ]
    faults += [
        f"no such path: {it}"
        for it in found(rf"\b((?:{'|'.join(ROOMS)})/[\w./-]*\w)", text)
        if not (ROOT / it).exists()
    ]
    faults += [
        f"no such launch file: {it}"
        for it in launch_files(text)
        if not (ROOT / "launch_scripts" / it).exists()
    ]
    faults += [f"line {line}: {count} words: {it}" for line, count, it in long_sentences(text)]
    faults += [f"{it}: {capsys.readouterr().err}" for it in commands(text) if not is_command(it)]
    others = LONGEST_PAGE if page in BY_HAND else sys.maxsize
    if words(page) > (most := MOST_WORDS.get(str(page.relative_to(ROOT)), others)):
        faults.append(f"{words(page)} words, which are more than {most}")
    assert not faults, "\n".join(faults)


def found(pattern: str, text: str) -> list[str]:
    """The first group of every match, each once."""
    return sorted({it[1] for it in re.finditer(pattern, text, re.MULTILINE)})


def launch_files(text: str) -> list[str]:
    return found(r"roslaunch musselbed (\S+\.launch)", text)


def commands(text: str) -> list[str]:
    """Lines of code blocks and pieces between backticks that begin with `musselbed`."""
    whole = found(r"^    (musselbed .*)$", text) + found(r"`(musselbed [^`]+)`", text)
    return [it.partition(" > ")[0] for it in whole]


def is_command(command: str) -> bool:
    """It parses, and the paths in it are there."""
    _, *its = shlex.split(command.replace("[", "").replace("]", ""), comments=True)
    arguments = [*its, "--help"] if len(its) == 1 else its
    try:
        parser(arguments).parse_args(arguments)
    except SystemExit as ended:
        if ended.code != 0:
            return False
    return all(not it.startswith(ROOMS) or (ROOT / it).exists() for it in its)


def faulty_links(page: Path, text: str) -> Iterator[str]:
    for target in found(r"\]\((?!https?:)([^)]+)\)", text):
        name, _, anchor = target.partition("#")
        linked = page.parent / name if name else page
        if not linked.is_file() or (anchor and anchor not in anchors(linked)):
            yield f"the link {target} leads nowhere"


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as Git's web pages and Sphinx make them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def is_marked(block: Block) -> bool:
    match block.mark:
        case "run" | "run beside a flight":
            return block.kind in ("sh", "python")
        case "file" | "not run":
            return bool(block.argument)
        case "tested":
            test = (ROOT / block.argument).read_text()
            orders = re.findall(
                r"^(?:musselbed|python) (\w+)|^(rosservice|roslaunch|ROS_NAMESPACE)", block.text, re.M
            )
            return block.page.name in test or all(
                any(word in test for word in order if word) for order in orders
            )
    return not block.mark and block.kind in EXCERPTS


def words(page: Path) -> int:
    """The words of a page, without its comments."""
    return len(re.sub(r"<!--.*?-->", "", page.read_text(), flags=re.DOTALL).split())


def test_a_page_that_is_wrong_is_found(tmp_path: Path) -> None:
    long = " ".join(["word"] * LONGEST_SENTENCE)
    page = tmp_path / "page.md"
    page.write_text(f"[two](page.md#there) [three](none.md)\n\n| {long} x |\n\n{long}.\n\n- {long}\n  x.\n")
    text = page.read_text()
    assert list(faulty_links(page, text)) == [
        "the link none.md leads nowhere",
        "the link page.md#there leads nowhere",
    ]
    assert [it[:2] for it in long_sentences(text)] == [(7, LONGEST_SENTENCE + 1)]
    assert is_command("musselbed replay RUN") and not is_command("musselbed replay --backwards RUN")
    assert not is_command("musselbed run launch_scripts/none.yaml")
    whole = "\n".join(it.read_text() for it in PAGES)
    assert launch_files(whole) and len(commands(whole)) > 100


@pytest.mark.parametrize("name", MAKE["PAGES"])
def test_a_made_page_is_what_the_code_gives(name: str) -> None:
    assert (ROOT / "docs/reference" / name).read_text() == MAKE["PAGES"][name](), "run docs/reference/make"


def test_each_page_of_the_reference_is_made() -> None:
    assert {page.name for page in MADE} == set(MAKE["PAGES"])


def test_every_key_of_a_scenario_has_its_row_with_a_meaning() -> None:
    sections = (ROOT / "docs/reference/scenario-keys.md").read_text().split("\n## ")
    tables = [dict(re.findall(r"^\| `(\w+)` \|.*\| (.*?) ?\|$", it, re.MULTILINE)) for it in sections]
    for schema in DATACLASSES:
        names = [field.name for field in dataclasses.fields(schema)]
        found = [it for it in tables if list(it) == names]
        # Where keys follow from a table, as those of each sensor and module, the block explains all of them.
        declared = re.findall(r"^    (\w+):", inspect.getsource(schema), re.MULTILINE)
        assert found and all(it[name] for it in found for name in declared if name in it), schema


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


def test_every_help_ends_with_two_commands_that_parse_and_has_no_long_sentence() -> None:
    faults = []
    for each in PARSERS:
        lines = each.format_help().splitlines()
        examples = [it.strip().partition(" > ")[0] for it in lines if it.startswith("  musselbed ")]
        faults += [it for it in examples if not it.startswith(each.prog) or not is_command(it)]
        faults += [f"{each.prog}: fewer than two examples"] if len(examples) < 2 else []
        texts = [each.description or "", *(action.help or "" for action in each._actions)]
        faults += [f"{each.prog}: {it}" for text in texts for it in long_sentences(text)]
    assert not faults


def test_the_page_of_results_is_what_the_archived_studies_give() -> None:
    make = [sys.executable, ROOT / "docs/results/make", "--check"]
    done = subprocess.run(make, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def test_the_index_lists_every_page_once_in_one_of_four_groups() -> None:
    index = ROOT / "docs" / "README.md"
    listed = re.findall(r"^- \[[^\]]+\]\(([^)]+)\): \S", index.read_text(), re.MULTILINE)
    pages = [str(page.relative_to(index.parent)) for page in (*BY_HAND, *MADE, TABLES) if page != index]
    whole = [link for link in listed if "#" not in link]
    assert not (dead := sorted({*whole} - {*pages})), f"docs/README.md links to no page: {', '.join(dead)}"
    assert sorted(whole) == sorted(pages), "add a line for the page to a group of docs/README.md"
    assert re.findall(r"^## (.*)$", index.read_text(), re.MULTILINE) == [
        "Tutorials",
        "How-to guides",
        "Reference",
        "Explanation",
    ]


def test_the_site_builds_without_a_warning_and_leads_to_every_page(tmp_path: Path) -> None:
    pytest.importorskip("furo")
    build = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", ROOT / "docs", tmp_path]
    built = subprocess.run(build, capture_output=True, text=True, timeout=300)
    assert built.returncode == 0, built.stderr
    index = (tmp_path / "README.html").read_text()
    for page in (*BY_HAND, *MADE, TABLES):
        link = page.relative_to(ROOT / "docs").with_suffix(".html")
        assert f'href="{link}"' in index or page.name == "README.md"


def test_the_page_of_commands_has_every_command_and_no_other() -> None:
    page = (ROOT / "docs/reference/commands.md").read_text()
    listed = re.findall(r"^##+ (musselbed .*)$", page, re.MULTILINE)
    assert sorted(listed) == sorted(each.prog for each in PARSERS if each.prog != "musselbed")


def test_the_page_of_trouble_has_the_exit_codes_of_every_help() -> None:
    page = (ROOT / "docs" / "trouble.md").read_text()
    rows = dict(re.findall(r"^\| (\d+) \| (.*) \|$", page, re.MULTILINE))
    assert {int(code) for code in rows} == {int(code) for code in Exit}
    for code, meaning in rows.items():
        words = re.split(r"[:,(]", meaning)[0].strip()
        assert f"{code} {words}" in EXITS


def test_no_docstring_begins_with_a_clause() -> None:
    clause = re.compile(r'^\s*"""(?:What|Of|Whether|Who|That|Where|How|As|To) ', re.MULTILINE)
    rooms = ("apad_bridge", "agents", "firmware_model", "benchmarks", "tests/campaigns")
    files = [it for room in rooms for it in sorted((ROOT / room).rglob("*.py"))]
    assert [str(it) for it in files if clause.search(it.read_text())] == []


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
