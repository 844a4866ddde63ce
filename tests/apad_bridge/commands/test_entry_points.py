"""Commands that packages bring: a stranger's is listed by its metadata, loaded for itself alone, and never by a stop."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from doc_blocks import TEMPLATES

from apad_bridge.commands.main import main
from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.doctor.interpreter import check_parts_of_others
from firmware_model.entry_points import EntryPoint, entry_points

SERVICES = (TEMPLATES / "command/lab_services.py").read_text() + "\nprint('loaded')\n"


def install(site: Path, package: str, module: str, text: str, version: str = "1.0") -> None:
    """Writes a package with the command of the template, as pip leaves it behind."""
    info = site / f"{package}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(
        f"[console_scripts]\nl = l:m\n\n[musselbed.commands]\nservices = {module}\n\n[musselbed.strategies]\na = b:C\n"
    )
    path = site.joinpath(*module.split(".")).with_suffix(".py")
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on the search path in which a stranger's package is installed."""
    install(tmp_path, "lab_tools", "lab_services", SERVICES)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


BROKEN, RECORD = SERVICES.replace("json.loads", "json.loadz"), "lab_tools-1.0.dist-info/RECORD"
LISTED = r"(?!.*loaded).*lab_tools:\n  services   The number of services of a run\n.*"
ITS_ERROR = r".*AttributeError.*musselbed services: this is an error of lab_tools 1.0: tell its authors\n"
RUNS: dict[str, tuple[dict[str, str], str, int, str, str]] = {
    "it is listed under its package without being loaded": ({}, "--help", 0, LISTED, ".*"),
    "it runs": ({"summary.json": '{"services": 8}'}, "services .", 0, "loaded\n8\n", ""),
    "a user's mistake is one line": ({}, "services .", 2, ".*", r"[^\n]*summary.json is not there[^\n]*\n"),
    # Not one that a stranger's command only calls, and not where the package has no list of files.
    "an error is nobody's": ({"summary.json": "{}", "lab_services.py": BROKEN}, "services .", 1, ".*", ".*"),
    "an error names its package": (
        {"summary.json": "{}", "lab_services.py": BROKEN, RECORD: "lab_services.py,sha256=x,9\n"},
        "services .",
        3,
        ".*",
        ITS_ERROR,
    ),
}
"""The files beside a stranger's package, what is typed, the exit code, and patterns of what is written."""


@pytest.mark.parametrize(("files", "words", "code", "out", "errors"), RUNS.values(), ids=RUNS)
def test_a_strangers_command(
    site: Path, files: dict[str, str], words: str, code: int, out: str, errors: str
) -> None:
    for name, text in files.items():
        (site / name).write_text(text)
    program = "import sys; from apad_bridge.commands.main import main; sys.exit(main(sys.argv[1:]))"
    path = {"PYTHONPATH": str(site), "PATH": "/usr/bin:/bin"}
    command = [sys.executable, "-c", program, *words.split()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=path, cwd=site)
    assert done.returncode == code, done.stderr
    assert re.fullmatch(out, done.stdout, re.DOTALL) and re.fullmatch(errors, done.stderr, re.DOTALL)


def test_a_command_without_a_docstring_or_a_file_has_its_name_alone(site: Path) -> None:
    (site / "no_docstring.py").write_text("import os\n")
    (site / "no_text.py").write_bytes(b"\xff\n")
    for module in ("no_docstring", "no_text", "nowhere.deep", "lab_tools.nowhere"):
        assert EntryPoint("lab", "it", module).line == ""


def test_a_mistyped_command_gets_the_nearest_of_a_strangers(
    site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["servces"]) == 2
    assert "did you mean `musselbed services`?" in capsys.readouterr().err


def test_a_command_of_two_packages_is_refused_and_both_are_named(
    site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(site, "pool_tools", "pool_tools.services", SERVICES)
    assert main(["services"]) == 2
    assert capsys.readouterr().err == (
        "musselbed: command services is in each of lab_tools, pool_tools: remove one of these packages\n"
    )


def test_the_first_version_on_the_path_counts(
    site: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    older = tmp_path_factory.mktemp("older")
    install(older, "lab_tools", "lab_tools.older", SERVICES, "0.9")
    monkeypatch.setattr(sys, "path", [*sys.path, str(older)])
    (found,) = [it for it in entry_points("musselbed.commands") if it.name == "services"]
    assert (found.package, found.module, found.brought_by) == ("lab_tools", "lab_services", "lab_tools 1.0")


@pytest.mark.parametrize("words", [["stop", "/nowhere"], ["order", "stop", "/nowhere"]])
def test_an_order_reads_no_metadata(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A search path with many packages delays no stop."""

    def refuse(group: str) -> list[EntryPoint]:
        raise AssertionError(group)

    monkeypatch.setattr("firmware_model.entry_points.entry_points", refuse)
    assert main(words) == 2


def test_the_doctor_loads_the_parts_and_names_those_that_fail_or_stand_twice(site: Path) -> None:
    install(site, "pool_tools", "pool_tools.services", SERVICES)
    (site / "lab_services.py").write_text("raise SystemExit(0)")
    found = [(it.check, it.found) for it in check_parts_of_others() if it.status is CheckStatus.WARN]
    assert ("commands", "services is in each of lab_tools 1.0, pool_tools 1.0") in found
    assert ("commands", "services of lab_tools 1.0 cannot be loaded: SystemExit: 0") in found
    assert not any("services of pool_tools" in text for _, text in found)
