"""One digest of a run whoever hosts the aMussels, and whatever code the processor chooses for its last bits."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest
from programs import code_here, done, lines_of
from scenario_files import POOL_FILE, SOUND_FILE, WHOLE_FILE, write_scenario

from agents.hosting.process_host import ProcessHost

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
OLD_PROCESSOR = {"OPENBLAS_CORETYPE": "Prescott", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"}
"""What OpenBLAS and glibc then choose was written for processors without AVX2 and FMA."""


def flown(scenario: Path, out: Path) -> str:
    assert code_here("run", scenario, "--time", "asap", "--out", out, "--json") == 0
    digest: str = json.loads((out / "summary.json").read_text())["digest"]
    return digest


def test_the_last_bits_of_libraries_do_not_matter(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of an old processor, another libm and another hash seed at once.

    Twins, ranges by sound, fixes by least squares, and plans by distance: all that computes with floats.
    """
    talk = {"ping_period_s": 20.0, "ping_worth_m": 1.0, "ask_worth_answers": 1.0}
    by_sound = write_scenario(
        tmp_path / "by-sound.yaml",
        SOUND_FILE,
        duration_s=1000.0,
        fleet={"hosting": "one_process"},
        mission={"pool_threshold": 0.95, "collection": "greedy"},
        water={"talk": talk, "localisation": {}},
    )
    digest = flown(by_sound, tmp_path / "plain")
    kinds = [it["kind"] for it in lines_of(tmp_path / "plain")]
    assert min(map(kinds.count, ("plan", "range", "fix", "released"))) > 0
    words = (sys.executable, "-c", OTHER_LIBM, "run", by_sound, "--time", "asap", "--out", tmp_path / "run")
    told = done(*words, env=os.environ | OLD_PROCESSOR | {"PYTHONHASHSEED": "7"}).stdout
    assert code_here("check", tmp_path / "run", "--digest", tmp_path / "plain") == 0, capsys.readouterr().out
    assert f"Digest of decisions and happenings: {digest}" in told


def test_an_old_processor_does_change_last_bits() -> None:
    """Else the test above would compare a library with itself."""
    if "avx2" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor has none of the code that the variant switches off")
    sines = "import math; print([math.sin(n / 7).hex() for n in range(99999)])"
    product = "import numpy; a = numpy.arange(36.0).reshape(6, 6) / 7; print((a @ a.T / 3 @ a).tobytes())"
    for program in (sines, product):
        here, there = (
            done(sys.executable, "-c", program, env=os.environ | it).stdout for it in ({}, OLD_PROCESSOR)
        )
        assert here != there


@pytest.mark.parametrize(("file", "looks"), [(POOL_FILE, [True, True]), (WHOLE_FILE, [False])])
def test_hosting_and_look_ahead_do_not_matter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: Path, looks: list[bool]
) -> None:
    """To the byte. Boards of the worst case look ahead; whole boards sleep, take samples, dock and upload."""
    changes: dict[str, Any] = {"duration_s": 1000.0, "mission": {"pool_threshold": 0.95}}
    processes = write_scenario(tmp_path / "flown.yaml", file, **changes)
    (tmp_path / "one").mkdir()
    fleet = {"hosting": "one_process"}
    one_process = write_scenario(tmp_path / "one" / "flown.yaml", file, **changes, fleet=fleet)
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
    flights = {f"processes {n}": processes for n in range(len(looks))} | {"one process": one_process}
    assert len({flown(scenario, tmp_path / name) for name, scenario in flights.items()}) == 1
    assert looked_ahead == looks
    runs = [tmp_path / name for name in flights]
    assert lines_of(runs[0], "released")
    if file == WHOLE_FILE:
        assert len({(run / "journal.jsonl").read_bytes() for run in runs}) == 1
        (samples,) = {(run / "samples.jsonl").read_bytes() for run in runs}
        states = {it["state"] for it in lines_of(runs[0], "truth")}
        assert {"SLEEPING", "SAMPLING", "PROCESSING", "AWAITING_SLOT", "TRANSMITTING", "REPORTING"} <= states
        assert samples


def test_two_runs_that_differ_are_told_by_the_first_event(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    early = {"pool_threshold": 0.95}
    one = write_scenario(tmp_path / "one.yaml", duration_s=200.0, mission=early)
    other = write_scenario(tmp_path / "other.yaml", one, mission={"batch": 3})
    digests = [flown(it, tmp_path / it.stem) for it in (one, other)]
    runs = [str(tmp_path / it.stem) for it in (one, other)]
    capsys.readouterr()
    assert code_here("check", runs[0], "--digest", runs[1]) == 1
    *lines, first, second = capsys.readouterr().out.splitlines()
    said = [f"{digest}  {run}" for digest, run in zip(digests, runs, strict=True)]
    assert lines == [*said, "the first event that differs:"]
    # Both plan at the same tick: four aMussels, and three.
    steps = [json.loads(line.split(", plan: ", 1)[1])["steps"] for line in (first, second)]
    assert [len(it) for it in steps] == [4, 3]
    assert code_here("check", runs[0], "--digest", runs[0], "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"digests": [digests[0]] * 2, "differing": None}
    assert code_here("check", *runs, "--digest", runs[0]) == 2
