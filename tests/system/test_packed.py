"""Archives of studies and runs: what a person unpacks elsewhere repeats its own figures, and notices others."""

from __future__ import annotations

import json
import platform
import shutil
import subprocess
from pathlib import Path

import pytest
from programs import ROOT, code_here, done
from scenario_files import POOL_FILE, write_scenario

from apad_bridge.scenario.loader import load, resolve
from apad_bridge.studies.packing import pinned

pytestmark = pytest.mark.system


def pool_beside(directory: Path) -> None:
    """A short scenario that names two files, which lie in a directory that the tests remove."""
    scenario = resolve(load(POOL_FILE))
    scenario["duration_s"] = 300.0
    shutil.copy(scenario["fleet"]["start"], directory / "starts.csv")
    shutil.copy(ROOT / "launch_scripts/interfaces/strings.yaml", directory / "topics.yaml")
    scenario["fleet"]["start"], scenario["apad"]["interface"] = "starts.csv", "topics.yaml"
    (directory / "short.yaml").write_text(json.dumps(scenario))


def unpacked(archive: Path, author: Path) -> Path:
    """The archive's folder elsewhere, where its author's files are gone."""
    shutil.rmtree(author)
    elsewhere = archive.with_name("elsewhere")
    elsewhere.mkdir()
    # By tar: Python's own extraction has other defaults and warnings from release to release.
    done("tar", "-xzf", archive, "-C", elsewhere)
    (folder,) = elsewhere.iterdir()
    return folder


def repeat(folder: Path, code: int | None = 0) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": "/usr/bin:/bin", "MUSSELBED": str(ROOT / "launch_scripts/musselbed")}
    return done("sh", folder / "repeat.sh", cwd="/", env=environment, code=code)


STUDY = {
    "name": "short",
    "scenarios": ["short.yaml"],
    "strategies": ["cautious", {"name": "one by one", "collection": "greedy", "batch": 1}],
    "seeds": 3,
    "start": "scenario",
    "parameters": {"mission.pool_threshold": [0.5, 0.8]},
}


def packed(tmp_path: Path, *words: object) -> Path:
    """What these words fly in a folder of its author, packed and unpacked elsewhere; a file there has changed since."""
    author, archive = tmp_path / "author", tmp_path / "archive.tar.gz"
    author.mkdir()
    (author / "study.yaml").write_text(json.dumps(STUDY))
    command, file, *options = words
    pool_beside(author)
    assert code_here(command, author / str(file), *options, "--out", author / "flown", "--json") == 0
    (author / "starts.csv").write_text("changed since\n")
    assert code_here("pack", author / "flown", "--out", archive) == 0
    return unpacked(archive, author)


def test_a_packed_study_repeats_its_figures_without_the_files_of_its_author(tmp_path: Path) -> None:
    folder = packed(tmp_path, "study", "study.yaml", "--seeds", 2)
    assert (folder / "study/report.html").is_file() and (folder / "study/results.parquet").is_file()
    pins = (folder / "requirements.txt").read_text()
    assert f"numpy=={dict(pinned())['numpy']} --hash=sha256:" in pins or platform.machine() != "x86_64"
    repeat(folder)
    shutil.rmtree(folder / "again")
    journal = folder / "study/trials.jsonl"
    journal.write_text(journal.read_text().replace('"metres":', '"metres":1', 1))
    assert repeat(folder, None).returncode != 0


def test_a_packed_run_repeats_its_summary(tmp_path: Path) -> None:
    folder = packed(tmp_path, "run", "short.yaml", "--time", "asap")
    assert (folder / "run/run.bag").is_file() and not (folder / "run/fleet").exists()
    crate = json.loads((folder / "ro-crate-metadata.json").read_text())
    entities = {it["@id"]: it for it in crate["@graph"]}
    assert entities["ro-crate-metadata.json"]["about"] == {"@id": "./"}
    parts = {it["@id"] for it in entities["./"]["hasPart"]}
    there = {it.relative_to(folder).as_posix() for it in folder.rglob("*") if it.is_file()}
    assert parts == there - {"ro-crate-metadata.json"} and parts <= entities.keys()
    assert {"name", "description", "datePublished", "license"} <= entities["./"].keys()
    assert "repeated" in repeat(folder).stdout


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that has nothing of a stranger."""
    folder = tmp_path_factory.mktemp("sound")
    scenario = write_scenario(folder / "short.yaml", duration_s=30, fleet={"hosting": "one_process"})
    assert code_here("run", scenario, "--time", "asap", "--out", folder / "run", "--json") == 0
    return folder / "run"


@pytest.mark.parametrize("at", ["notes.txt", "imc/notes.txt", "imc", "scenario.yaml", ".hidden"])
def test_a_link_is_refused_by_name_and_nothing_of_its_target_is_packed(
    at: str, sound: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An archive is published: a link to a private file, anywhere in the directory, was in it as that file."""
    run, private = shutil.copytree(sound, tmp_path / "run"), tmp_path / "private"
    private.mkdir()
    (private / "notes.txt").write_text("secret")
    link = run / at
    link.parent.mkdir(exist_ok=True)
    if at == "scenario.yaml":
        shutil.move(link, private / "scenario.yaml")
    link.symlink_to(private if at == "imc" else private / Path(at).name)
    assert code_here("pack", run, "--out", tmp_path / "x.tar.gz") == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert f"{link}: a symbolic link, to {private}" in told
    assert not (tmp_path / "x.tar.gz").exists()


def test_what_is_no_study_and_no_run_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    assert code_here("pack", empty, "--out", tmp_path / "x.tar.gz") == 2
    assert "neither a study (trials.jsonl) nor a run" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [empty]
