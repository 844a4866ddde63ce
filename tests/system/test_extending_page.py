"""docs/first-strategy.md as printed, and the templates: packages are installed and flown, and a board is compiled."""

from __future__ import annotations

import csv
import json
import os
import re
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path
from shutil import copytree, which
from typing import Any

import pytest
from doc_blocks import TEMPLATES, blocks, file_of
from graphs import served_pool, somebodys_graph
from programs import ROOT, begun, done, ended_well, lines_of, wait_until

pytestmark = pytest.mark.system
STRATEGY = ROOT / "docs" / "first-strategy.md"
POOL = ROOT / "launch_scripts" / "scenarios" / "pool-12.yaml"
WHOLE = POOL.with_name("whole-board-12.yaml")
"""The pool with whole boards."""
BOAT_OPTION = "--no-build-isolation"


def commands() -> list[str]:
    """The page's commands: to fly, to compare, and to install."""
    return [block.text for block in blocks(STRATEGY) if block.mark == "tested"]


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A shell's variables in which `musselbed` is on PATH, in an environment that may be changed.

    It has all that musselbed's own environment has. The page's command installs into the environment of the `musselbed`
    that the shell finds. So PATH has no other: a checkout's own would keep the packages, by whichever path it is named.
    """
    place = tmp_path_factory.mktemp("place") / "environment"
    done(sys.executable, "-m", "venv", "--without-pip", place)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    beside = sysconfig.get_path("purelib")
    line = f"import site; site.addsitedir({beside!r})\n"
    (place / "lib" / version / "site-packages" / "beside.pth").write_text(line)
    (place / "share").symlink_to(Path(sys.prefix) / "share")  # the ROS messages that the installer made
    program = place / "bin" / "musselbed"
    program.write_text(
        f"#!{place}/bin/python\nfrom apad_bridge.commands.main import main\nraise SystemExit(main())\n"
    )
    program.chmod(0o755)
    others = [it for it in os.environ["PATH"].split(":") if not Path(it, program.name).exists()]
    variables = {**os.environ, "PATH": ":".join([*others, str(program.parent)])}
    assert in_a_shell("command -v musselbed", place, variables) == f"{program}\n"
    return variables


def in_a_shell(script: str, folder: Path, environment: dict[str, str], *, code: int = 0) -> str:
    """What a script prints that ends with this code; for another than 0 what it prints as its error."""
    ended = done("bash", "-eu", "-c", script, cwd=folder, env=environment, code=code)
    return ended.stderr if code else ended.stdout


def install(folder: Path, environment: dict[str, str], *kinds: str) -> None:
    """As on a boat: from no index. The setuptools at hand builds them, which pip looks for there without the option."""
    assert f"`{BOAT_OPTION}`" in STRATEGY.read_text()
    for kind in kinds:
        copytree(TEMPLATES / kind, folder / kind)
    command = commands()[-1].rstrip().removesuffix(".") + " ".join(f"./{it}" for it in kinds)
    in_a_shell(f"{command} {BOAT_OPTION}", folder, environment | {"PIP_NO_INDEX": "1"})


def others_of(run: Path) -> dict[str, str]:
    versions: dict[str, dict[str, str]] = json.loads((run / "versions.json").read_text())
    return versions["packages_of_others"]


def test_a_template_has_three_files_at_most_and_those_of_the_pages() -> None:
    assert all(len(list(it.iterdir())) <= 3 for it in TEMPLATES.iterdir())
    strategy = (TEMPLATES / "strategy/lab_strategies.py").read_text()
    board = (TEMPLATES / "board/my_board.c").read_text()
    assert strategy == file_of(STRATEGY, "lab_strategies.py")
    assert board == file_of(ROOT / "docs/first-firmware.md", "my_board.c")


@pytest.mark.skipif(which("cc") is None or which("make") is None, reason="make compiles the board in C")
def test_the_templates_board_compiles_and_runs(tmp_path: Path, environment: dict[str, str]) -> None:
    copytree(TEMPLATES / "board", tmp_path / "board")
    assert in_a_shell("make >/dev/null && musselbed mu run ./my_board", tmp_path / "board", environment)


WITHOUT = "before/scenario.yaml: sensors: flown without the sensor salinity of lab_sensors 1.2, which is installed here"
WITH = "run/scenario.yaml: sensors: flown with the sensor salinity of lab_sensors 1.2, which is not installed here"
BROKEN = (
    r"the sensor salinity of lab_sensors 1.2 \(lab_sensors:SALINITY\) cannot be loaded: Mod.*uninstall it"
)


def test_a_sensor_of_a_package_is_flown_and_its_runs_need_it(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    (tmp_path / "pool-12.csv").write_text(POOL.with_suffix(".csv").read_text())
    # Its first batch is collected early, so that samples come ashore.
    whole = WHOLE.read_text().replace("pool_threshold: 0.6", "pool_threshold: 0.95")
    assert whole.count("duration_s: 14400") == 1
    (tmp_path / "whole.yaml").write_text(whole.replace("duration_s: 14400", "duration_s: 20"))
    salty = "water: {fields: {salinity_psu: [[0, 10], [3, 30]]}}\n"
    (tmp_path / "salty.yaml").write_text(whole.replace("duration_s: 14400", "duration_s: 520") + salty)
    before, prefix = tmp_path / "before/scenario.yaml", Path(environment["PATH"].rpartition(":")[2]).parent

    def module() -> Path:
        (found,) = prefix.glob("lib/*/site-packages/lab_sensors.py")
        return found

    steps: list[tuple[Callable[[], object], str, int, str]] = [
        (lambda: None, "run whole.yaml --time asap --out before", 0, ""),
        (lambda: None, "run salty.yaml --time asap --out refused", 2, "salinity_psu: unknown key"),
        (lambda: install(tmp_path, environment, "sensor"), "run salty.yaml --time asap --out run", 0, ""),
        (lambda: None, "check run", 0, "^run: all rules hold\n$"),
        (lambda: check_salinity(tmp_path, environment), "check before", 2, WITHOUT),
        # A run of a version that kept no list was flown without them, too.
        (
            lambda: before.write_text(before.read_text().replace("sensors: []\n", "")),
            "check before",
            2,
            WITHOUT,
        ),
        (lambda: module().write_text("import nowhere\n"), "run whole.yaml", 2, BROKEN),
        (lambda: None, "python -m pip uninstall --yes lab_sensors", 0, ""),
        (lambda: None, "check run", 2, WITH),
        (lambda: None, "export run --to csv", 0, ""),
    ]
    for act, words, code, said in steps:
        act()
        assert re.search(said, in_a_shell(f"musselbed {words}", tmp_path, environment, code=code)), words
    with (tmp_path / "run/export-csv/samples.csv").open() as file:
        exported = [float(it["salinity_psu"]) for it in csv.DictReader(file)]
    assert exported == [it["salinity_psu"] for it in samples_of(tmp_path)]


def samples_of(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "run/samples.jsonl").read_text().splitlines()]


def check_salinity(folder: Path, environment: dict[str, str]) -> None:
    """By hand: 60 mW of a battery of 7.4 Wh, for as long as the sensors are on."""
    samples = samples_of(folder)
    assert len(samples) >= 5 and len({it["salinity_psu"] for it in samples}) > 1
    for it in samples:
        # Each lies at 3 m. A noise is within 4.9 deviations of 0.02, and a count is 0.001.
        assert it["salinity_psu"] == pytest.approx(30.0, abs=4.9 * 0.02 + 0.0005)
        assert it["salinity_psu"] == pytest.approx(-1.0 + 0.001 * it["counts"][4], abs=1e-9)
    for it in json.loads(in_a_shell("musselbed mu energy run --json", folder, environment)):
        hours = it["state_hours"].get("sampling", 0) + it["state_hours"].get("reporting", 0)
        assert hours > 0 and it["is_exact"]
        assert it["by_module"]["salinity"] == pytest.approx(0.060 * hours / 7.4, rel=1e-4)
    assert others_of(folder / "run") == {"lab_sensors 1.2": "sensors salinity"}


def test_the_templates_install_and_fly(tmp_path: Path, environment: dict[str, str]) -> None:
    copytree(TEMPLATES / "strategy", tmp_path / "strategies")
    in_a_shell(commands()[-1], tmp_path / "strategies", environment)
    # Its file alone flies, and is compared.
    (tmp_path / "lab_strategies.py").write_text(file_of(STRATEGY, "lab_strategies.py"))
    (tmp_path / "farthest.yaml").write_text(
        file_of(STRATEGY, "farthest.yaml").replace("seeds: 20", "seeds: 2")
    )
    # The pages' commands name the shipped pool; here it lasts until the time that one of them asks about.
    text = POOL.read_text().replace("duration_s: 2400", "duration_s: 610")
    # A file of that name comes before the shipped scenario.
    (tmp_path / "pool-12").write_text(text)
    (tmp_path / "pool-12.csv").write_text(POOL.with_suffix(".csv").read_text())
    fly, compare, _ = commands()
    assert "no reasons given" in in_a_shell(fly, tmp_path, environment)
    assert "lab_strategies.py:Farthest" in in_a_shell(compare, tmp_path, environment)

    install(tmp_path, environment, "codec", "command")
    (tmp_path / "lines.yaml").write_text(
        text.replace("hearing: {", "hearing: {codec: lines, ").replace("610", "60")
    )
    in_a_shell(
        "musselbed run lines.yaml --strategy farthest --time asap --out run; musselbed services run",
        tmp_path,
        environment,
    )
    flown = (tmp_path / "run" / "scenario.yaml").read_text()
    assert "codec: lines" in flown and "collection: farthest" in flown
    assert any(it["strategy"] == "farthest" for it in lines_of(tmp_path / "run", "plan"))
    assert others_of(tmp_path / "run") == {
        "lab_codec 1.2": "codecs lines",
        "lab_services 1.2": "commands services",
        "lab_strategies 1.2": "strategies farthest",
    }
    assert "lab_codec 1.2: codecs lines" in in_a_shell(
        "musselbed doctor --all || true", tmp_path, environment
    )


def test_the_templates_stack_flies_a_boat_of_its_own(tmp_path: Path, environment: dict[str, str]) -> None:
    """A boat that has none of our names is recognised, served, stopped, and named in the records."""
    install(tmp_path, environment, "stack")
    scenario, orders = served_pool(tmp_path / "boat.yaml", 4, 36_000), tmp_path / "orders"
    boat = [sys.executable, str(Path(__file__).with_name("lab_boat.py")), "apad1", "2", "2", str(orders)]
    told = in_a_shell(f"musselbed run {scenario} --generation lab", tmp_path, environment, code=2)
    assert "brings no simulated aPad" in told
    with somebodys_graph(scenario, tmp_path, 8, boat) as graph:
        graph |= {"PATH": environment["PATH"]}
        doctor = in_a_shell("musselbed doctor --all || true", tmp_path, graph)
        assert "an aPad with the service helm/off" in doctor
        run, fly = (
            tmp_path / "run",
            ("musselbed", "run", scenario, "--time", "ros", "--apad", "ros", "--json"),
        )
        with begun(*fly, "--out", run, env=graph) as flight:
            wait_until(lambda: lines_of(run, "released"), flight)
            in_a_shell(f"musselbed stop {run} --off", tmp_path, graph)
            wait_until(lambda: orders.read_text().endswith("off\n"), flight)
            stopped, since_ms = orders.read_text(), lines_of(run)[-1]["t"]
            wait_until(lambda: lines_of(run)[-1]["t"] > since_ms + 20_000, flight)
            assert orders.read_text() == stopped
            in_a_shell(f"musselbed abort {run}", tmp_path, graph)
            ended_well(flight)
    assert lines_of(run, "dock")
    assert others_of(run)["lab_stack 1.2"] == "stacks lab"
