"""Commands that look execute no code of a stranger's run or scenario. The commands are those of the program."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
import yaml
from programs import begun, code_here, line_of
from scenario_files import write_scenario

from apad_bridge.commands.main import all_groups

pytestmark = pytest.mark.system

MUSSELBED = Path(__file__).parents[2] / "launch_scripts" / "musselbed"
FLY_WHAT_IS_TYPED = {"run", "script", "study", "mission", "fleet", "python"}
COMMANDS = {name for commands in all_groups().values() for name in commands}
LOOKS: dict[str, tuple[list[str], ...]] = {
    "resume": (["."],),
    "apad": (["scenario.yaml"],),
    "order": (["stop", "."],),
    "stop": (["."],),
    "hands": (["."],),
    "give-back": (["."],),
    "continue": (["."],),
    "back-in": (["."],),
    "abort": (["."],),
    "remark": (["."],),
    "speed": ([".", "5"],),
    "console": (["."],),
    "foxglove": (["."],),
    "imc": (["."],),
    "ros2": (["."],),
    "runs": ([".."],),
    "replay": (["."],),
    "report": (["."],),
    "explain": (["."],),
    "beliefs": (["."],),
    "check": (["."], [".", "--digest", "."]),
    "export": (
        ["--to", "csv", "--out", "csv", "."],
        ["--to", "mcap", "--out", "run.mcap", "."],
        ["--to", "mat", "--out", "run.mat", "."],
        ["--to", "parquet", "--out", "parquet", "."],
    ),
    "branch": (["--at", "100", "--set", "charge_to=0.8", "."],),
    "pack": (["--out", "packed.tar.gz", "."],),
    "capacity": (["scenario.yaml"], ["--fly", "scenario.yaml"]),
    "new": (["--like", "scenario.yaml", "new.yaml"],),
    "doctor": (["scenario.yaml"],),
    "layout": (["rviz", "scenario.yaml"], ["foxglove", "scenario.yaml"]),
    "preflight": (["scenario.yaml"],),
    "bridge": ([".", "/dev/null"], ["scenario.yaml", "/dev/null"]),
    "modems": (["modems"],),
    "shadow": (["scenario.yaml", "run.bag"],),
    "logs": (["merge", "run.bag", "run.bag", "--out", "merged.bag"],),
    "calibrate": (["--scenario", "scenario.yaml", "run.bag"],),
    "fit": (["battery", "starts.csv"],),
    "mu": (["energy", "."], ["states"], ["run", "scenario.yaml"]),
}
"""The words by which each command looks at the run in the present folder, and at its scenario."""
READ = {"runs", "replay", "report", "beliefs", "check", "export", "pack", "new", "layout", "doctor"}
"""Of those, the ones that succeed whatever strategies, firmware and scripts the run was flown with."""
CODE = """\
from pathlib import Path

from apad_bridge.planning.strategies.paper_strategies import Greedy, GreedyRedeploy
from firmware_model.packets.codec import MusselbedCodec

Path({marks!r}, {name!r}).write_text("")
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sound run of 200 s."""
    folder = tmp_path_factory.mktemp("flown")
    fleet = {"start": {"charge": [0.5, 0.7]}, "hosting": "one_process"}
    path = write_scenario(folder / "scenario.yaml", duration_s=200, fleet=fleet)
    assert code_here("run", path, "--time", "asap", "--out", folder / "run") == 0
    return folder / "run"


def strangers(flown: Path, tmp_path: Path, codec: str) -> tuple[Path, Path]:
    """The run as a stranger sends it, with code in each place; and the folder in which executed code leaves marks."""
    run, marks = tmp_path / "run", tmp_path / "executed"
    shutil.copytree(flown, run)
    marks.mkdir()
    data = yaml.safe_load((run / "scenario.yaml").read_text())
    data["mission"] |= {"collection": "evil.py:Greedy", "redeployment": "home.py:GreedyRedeploy"}
    data["hearing"]["codec"] = codec
    shell = {"executable": "/bin/sh", "arguments": ["-c", f"touch {marks}/firmware"]}
    data["fleet"] |= {"firmware": [shell], "hosting": "processes"}
    (run / "scenario.yaml").write_text(yaml.safe_dump(data))
    options = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps({**options, "script": str(run / "script.py")}))
    # Strategies, a script, a codec by an entry point beside the run, and modules that the program itself imports.
    names = [
        "evil",
        "home",
        "script",
        "evil_codec",
        "json",
        "yaml",
        "numpy",
        "agents",
        "sitecustomize",
        "conftest",
    ]
    for name in names:
        (run / f"{name}.py").write_text(CODE.format(marks=str(marks), name=name))
    info = run / "evil-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: evil\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[musselbed.codecs]\nevil = evil_codec:MusselbedCodec\n\n"
        "[musselbed.strategies]\ngreedy-redeploy = evil_codec:Greedy\n"
    )
    return run, marks


def look(run: Path, words: list[str]) -> subprocess.CompletedProcess[str]:
    """Runs the command in the run's directory, with an empty entry in PYTHONPATH, and ends one that serves.

    A server is ended when it has written the line with its address.
    """
    environment = {**os.environ, "PYTHONPATH": f":{os.environ.get('PYTHONPATH', '')}:"}
    environment |= {"XDG_STATE_HOME": str(run.parent / "state"), "ROS_MASTER_URI": "http://127.0.0.1:1"}
    with begun(MUSSELBED, *words, cwd=run, env=environment, stdin=subprocess.DEVNULL) as command:
        first = ""
        if words[0] in ("console", "foxglove", "imc", "modems", "bridge", "apad"):
            first = line_of(command)
            command.send_signal(signal.SIGINT)
        told, failed = command.communicate(timeout=120)
    return subprocess.CompletedProcess(words, command.returncode, first + told, failed)


def test_each_command_is_looked_at() -> None:
    assert LOOKS.keys() | FLY_WHAT_IS_TYPED == COMMANDS


@pytest.mark.parametrize("command", LOOKS)
def test_no_command_that_looks_executes_a_strangers_code(command: str, flown: Path, tmp_path: Path) -> None:
    """With a codec that nobody here has, all stop at the scenario: some of them, by their first words alone."""
    evil = LOOKS[command][:1] if command in ("resume", "replay", "export", "doctor", "bridge") else ()
    for codec, looks in (("musselbed-1", LOOKS[command]), ("evil", evil)):
        run, marks = strangers(flown, tmp_path / codec, codec)
        for words in looks:
            looked = look(run, [command, *words])
            assert [it.name for it in marks.iterdir()] == [], words
            assert "Traceback" not in looked.stderr, looked.stderr
            if command in READ and codec == "musselbed-1":
                assert looked.returncode in (0, 3), looked.stderr
