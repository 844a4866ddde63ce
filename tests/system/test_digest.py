"""One digest of a run whoever hosts the aMussels, and whatever code the processor chooses for its last bits."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from scenario_files import POOL_FILE, SOUND_FILE

from agents.hosting.process_host import ProcessHost
from apad_bridge.commands.main import main
from apad_bridge.scenario.loader import load, resolve

pytestmark = pytest.mark.system

OTHER_LIBM = """
import math, sys


def beside(exact):
    def found(*values):
        value = exact(*values)
        exact_too = value in (0.0, 1.0, -1.0) or not math.isfinite(value)
        return value if exact_too else math.nextafter(value, math.inf if hash(value) & 1 else -math.inf)

    return found


for name in ("sin", "cos", "tan", "atan", "atan2", "tanh", "exp", "log", "log10", "pow"):
    setattr(math, name, beside(getattr(math, name)))
from apad_bridge.commands.main import main

sys.exit(main(sys.argv[1:]))
"""
"""The command with a mathematical library whose every result is the float beside the right one: worse than any real one."""
COMMAND = "import sys; from apad_bridge.commands.main import main; sys.exit(main(sys.argv[1:]))"
OLD_PROCESSOR = {"OPENBLAS_CORETYPE": "Prescott", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"}
"""What OpenBLAS and glibc then choose was written for processors without AVX2 and FMA."""
VARIANTS: dict[str, tuple[str, dict[str, str]]] = {
    "an old processor": (COMMAND, OLD_PROCESSOR),
    "another libm": (OTHER_LIBM, {}),
    "another hash seed": (COMMAND, {"PYTHONHASHSEED": "7"}),
}


def scenario_of(path: Path, file: Path, **changes: Any) -> Path:
    """A copy of a scenario file with other values, by the names of their blocks with a double underscore."""
    scenario = resolve(load(file))
    scenario["fleet"]["start"] = str(file.with_name("pool.csv"))
    for name, value in changes.items():
        *blocks, key = name.split("__")
        block = scenario
        for it in blocks:
            block = block[it]
        block[key] = value
    path.write_text(json.dumps(scenario))
    return path


def flown(scenario: Path, out: Path) -> str:
    assert main(["run", str(scenario), "--time", "asap", "--out", str(out), "--json"]) == 0
    digest: str = json.loads((out / "summary.json").read_text())["digest"]
    return digest


@pytest.fixture(scope="module")
def by_sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twins, ranges by sound, fixes by least squares, and plans by distance: all that computes with floats."""
    return scenario_of(
        tmp_path_factory.mktemp("scenario") / "by-sound.json",
        SOUND_FILE,
        duration_s=1000.0,
        mission__pool_threshold=0.95,
        mission__collection="greedy",
        water__talk={"ping_period_s": 20.0, "ping_worth_m": 1.0, "ask_worth_answers": 1.0},
        water__localisation={},
    )


@pytest.fixture(scope="module")
def plain(by_sound: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("plain") / "run"
    flown(by_sound, run)
    return run


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_last_bits_of_libraries_do_not_matter(
    variant: str, by_sound: Path, plain: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, variables = VARIANTS[variant]
    run = tmp_path / "run"
    done = subprocess.run(
        [sys.executable, "-c", program, "run", str(by_sound), "--time", "asap", "--out", str(run)],
        env=os.environ | variables,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    kinds = [json.loads(line)["kind"] for line in (plain / "journal.jsonl").read_text().splitlines()]
    assert min(map(kinds.count, ("plan", "range", "fix", "released"))) > 0
    assert main(["check", str(run), "--digest", str(plain)]) == 0, capsys.readouterr().out
    assert (
        f"Digest of decisions and happenings: {json.loads((plain / 'summary.json').read_text())['digest']}"
        in done.stdout
    )


def test_an_old_processor_does_change_last_bits() -> None:
    """Else the test above would compare a library with itself."""
    if "avx2" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor has none of the code that the variant switches off")
    sines = "import math; print([math.sin(n / 7).hex() for n in range(99999)])"
    product = "import numpy; a = numpy.arange(36.0).reshape(6, 6) / 7; print((a @ a.T / 3 @ a).tobytes())"
    for program in (sines, product):
        here, there = (
            subprocess.run(
                [sys.executable, "-c", program], env=environment, check=True, capture_output=True, timeout=60
            ).stdout
            for environment in (os.environ, os.environ | OLD_PROCESSOR)
        )
        assert here != there


def test_hosting_and_look_ahead_do_not_matter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    changes = {"duration_s": 900.0, "mission__pool_threshold": 0.8}
    processes = scenario_of(tmp_path / "processes.json", POOL_FILE, **changes)
    one_process = scenario_of(tmp_path / "one.json", POOL_FILE, **changes, fleet__hosting="one_process")
    looked_ahead: list[bool] = []
    adopt = ProcessHost.adopt.__func__  # type: ignore[attr-defined]

    def adopted(
        cls: type[ProcessHost], *arguments: Any, looks_ahead: bool = False, **named: Any
    ) -> ProcessHost:
        looked_ahead.append(looks_ahead)
        host: ProcessHost = adopt(
            cls, *arguments, looks_ahead=looks_ahead and len(looked_ahead) == 1, **named
        )
        return host

    monkeypatch.setattr(ProcessHost, "adopt", classmethod(adopted))
    digests = [
        flown(scenario, tmp_path / name)
        for name, scenario in (
            ("ahead", processes),
            ("step by step", processes),
            ("one process", one_process),
        )
    ]
    assert looked_ahead == [True, True]
    assert '"kind":"released"' in (tmp_path / "ahead" / "journal.jsonl").read_text()
    assert len(set(digests)) == 1


def test_two_runs_that_differ_are_told_by_the_first_event(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = scenario_of(tmp_path / "one.json", POOL_FILE, duration_s=200.0, mission__pool_threshold=0.95)
    other = scenario_of(
        tmp_path / "other.json", POOL_FILE, duration_s=200.0, mission__pool_threshold=0.95, mission__batch=3
    )
    digests = [flown(scenario, tmp_path / scenario.stem) for scenario in (one, other)]
    capsys.readouterr()
    assert digests[0] != digests[1]
    runs = [str(tmp_path / name) for name in ("one", "other")]
    assert main(["check", runs[0], "--digest", runs[1]]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[:3] == [
        f"{digests[0]}  {runs[0]}",
        f"{digests[1]}  {runs[1]}",
        "the first event that differs:",
    ]
    # Both plan at the same tick: four aMussels, and three.
    told = [json.loads(line.split(", plan: ", 1)[1]) for line in lines[3:]]
    assert [len(it["steps"]) for it in told] == [4, 3]
    assert main(["check", runs[0], "--digest", runs[0], "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"digests": [digests[0]] * 2, "differing": None}
    assert main(["check", *runs, "--digest", runs[0]]) == 2
    assert "name one RUN" in capsys.readouterr().err
