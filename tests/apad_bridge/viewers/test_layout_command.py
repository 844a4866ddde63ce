"""`musselbed layout`: its output files, and its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

from apad_bridge.commands.main import main

POOL = str(POOL_FILE)


def test_a_file_is_written_and_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is kept unless forced when it is there."""
    out = tmp_path / "mine.rviz"
    assert main(["layout", "rviz", POOL, "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    assert out.read_text().startswith("Panels:") and list(tmp_path.iterdir()) == [out]
    out.write_text("arranged by hand")
    assert main(["layout", "rviz", POOL, "--out", str(out)]) == 2
    assert "exists already: replace it with --force" in capsys.readouterr().err
    assert out.read_text() == "arranged by hand"
    assert main(["layout", "rviz", POOL, "--out", str(out), "--force"]) == 0
    assert out.read_text().startswith("Panels:")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--namespace", "bay north"], "--namespace bay north: names of letters"),
        (["--namespace", "a//b"], "--namespace a//b: names of letters"),
        (["--out", "."], "is a directory: name a file in it"),
        (["--out", "nowhere/mine.rviz"], "nowhere/mine.rviz: No such file or directory"),
    ],
)
def test_mistakes_are_one_line(
    more: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["layout", "rviz", POOL, *more]) == 2
    told = capsys.readouterr()
    assert said in told.err and told.err.count("\n") == 1 and told.out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("namespace", "names"),
    [
        *((it, "bay/north/musselbed") for it in ("bay/north", "/bay/north", "/bay/north/")),
        ("", "musselbed"),
        ("/", "musselbed"),
    ],
)
def test_a_namespace_however_it_is_written(
    namespace: str, names: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["layout", "rviz", POOL, "--namespace", namespace, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["kind"] == "rviz" and f"Marker Topic: /{names}/markers" in told["text"]
    assert f"Fixed Frame: {names}/enu\n" in told["text"]
