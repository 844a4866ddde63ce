"""docs/first-strategy.md as printed, and the templates: packages are installed and flown, and a board is compiled."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from shutil import copytree, which

import pytest
from doc_blocks import TEMPLATES, blocks, file_of
from graphs import lines_of, served_pool, somebodys_graph, wait_until
from patient import PATIENCE_S

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
STRATEGY = ROOT / "docs" / "first-strategy.md"
POOL = ROOT / "launch_scripts" / "scenarios" / "pool-12.yaml"
WHOLE = POOL.with_name("whole-board-12.yaml")
"""The pool with whole boards."""
BOAT_OPTION = "--no-build-isolation"


def commands() -> list[str]:
    """The page's commands: to fly, to compare, and to install."""
    return [block.text for block in blocks(STRATEGY) if block.mark == "tested"]


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """A shell's variables in which `musselbed` is on PATH, in an environment that may be changed.

    It has all that musselbed's own environment has. The page's command installs into the environment of the `musselbed`
    that the shell finds. So PATH has no other: a checkout's own would keep the packages, by whichever path it is named.
    """
    place = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", place], check=True, timeout=180)
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
    assert in_a_shell("command -v musselbed", tmp_path, variables) == f"{program}\n"
    return variables


def in_a_shell(script: str, folder: Path, environment: dict[str, str], *, code: int = 0) -> str:
    """What a script prints that ends with this code; for another than 0 what it prints as its error."""
    done = subprocess.run(
        ["bash", "-eu", "-c", script],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stderr if code else done.stdout


def install(kind: str, folder: Path, environment: dict[str, str], *, options: str = "") -> None:
    copytree(TEMPLATES / kind, folder)
    in_a_shell(f"{commands()[-1].rstrip()} {options}", folder, environment)


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


def test_the_templates_install_and_fly(tmp_path: Path, environment: dict[str, str]) -> None:
    install("strategy", tmp_path / "strategies", environment)
    # Before the package is there: its file alone flies, and is compared.
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

    # As on a boat: from no index. The setuptools at hand builds it; without the page's option pip looks for one there.
    assert f"`{BOAT_OPTION}`" in STRATEGY.read_text()
    on_a_boat = environment | {"PIP_NO_INDEX": "1"}
    install("codec", tmp_path / "codec", on_a_boat, options=BOAT_OPTION)
    install("command", tmp_path / "command", on_a_boat, options=BOAT_OPTION)
    scenario = tmp_path / "lines.yaml"
    scenario.write_text(text.replace("hearing: {", "hearing: {codec: lines, ").replace("610", "60"))
    in_a_shell(
        f"musselbed run '{scenario}' --strategy farthest --time asap --out '{tmp_path}/run'",
        tmp_path,
        environment,
    )
    flown = (tmp_path / "run" / "scenario.yaml").read_text()
    assert "codec: lines" in flown and "collection: farthest" in flown
    plans = [
        line for line in (tmp_path / "run" / "journal.jsonl").read_text().splitlines() if '"plan"' in line
    ]
    assert any('"farthest"' in line for line in plans)
    others = json.loads((tmp_path / "run/versions.json").read_text())["packages_of_others"]
    assert others == {
        "lab_codec 1.2": "codecs lines",
        "lab_services 1.2": "commands services",
        "lab_strategies 1.2": "strategies farthest",
    }
    assert "lab_codec 1.2: codecs lines" in in_a_shell(
        "musselbed doctor --all || true", tmp_path, environment
    )
    assert in_a_shell("musselbed services run", tmp_path, environment).strip().isdigit()


def test_the_templates_stack_flies_a_boat_of_its_own(tmp_path: Path, environment: dict[str, str]) -> None:
    """A boat that has none of our names is recognised, served, stopped, and named in the records."""
    install("stack", tmp_path / "stack", environment, options=BOAT_OPTION)
    scenario, orders, run = (
        served_pool(tmp_path / "boat.yaml", 4, 36_000),
        tmp_path / "orders",
        tmp_path / "run",
    )
    boat = [sys.executable, str(Path(__file__).with_name("lab_boat.py")), "apad1", "2", "2", str(orders)]
    simulated = subprocess.run(
        ["musselbed", "run", scenario, "--generation", "lab"], env=environment, capture_output=True, text=True
    )
    assert simulated.returncode == 2 and "brings no simulated aPad" in simulated.stderr
    with somebodys_graph(scenario, tmp_path, 4, boat) as graph:
        graph |= {"PATH": environment["PATH"]}
        assert "an aPad with the service helm/off" in in_a_shell(
            "musselbed doctor --all || true", tmp_path, graph
        )
        fly = ["musselbed", "run", scenario, "--time", "ros", "--apad", "ros", "--out", run, "--json"]
        with subprocess.Popen(
            fly, env=graph, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as flight:
            wait_until(lambda: run.exists() and any(it["kind"] == "released" for it in lines_of(run)), flight)
            in_a_shell(f"musselbed stop {run} --off", tmp_path, graph)
            wait_until(lambda: orders.read_text().endswith("off\n"), flight)
            stopped = orders.read_text()
            since_ms = lines_of(run)[-1]["t"]
            wait_until(lambda: lines_of(run)[-1]["t"] > since_ms + 20_000, flight)
            assert orders.read_text() == stopped
            in_a_shell(f"musselbed abort {run}", tmp_path, graph)
            _, said = flight.communicate(timeout=PATIENCE_S)
        assert flight.returncode == 0, said
    assert any(it["kind"] == "dock" for it in lines_of(run))
    others = json.loads((run / "versions.json").read_text())["packages_of_others"]
    assert others == {"lab_stack 1.2": "stacks lab"}


def test_a_sensor_of_a_package_is_flown_and_its_runs_need_it(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    def musselbed(words: str, code: int = 0) -> str:
        return in_a_shell(f"musselbed {words}", tmp_path, environment, code=code)

    (tmp_path / "pool-12.csv").write_text(POOL.with_suffix(".csv").read_text())
    # Its first batch is collected early, so that samples come ashore.
    whole = WHOLE.read_text().replace("duration_s: 2400", "duration_s: 520")
    (tmp_path / "whole.yaml").write_text(whole.replace("pool_threshold: 0.6", "pool_threshold: 0.95"))
    (tmp_path / "worst.yaml").write_text(POOL.read_text().replace("duration_s: 2400", "duration_s: 30"))
    salty = (tmp_path / "whole.yaml").read_text() + "water: {fields: {salinity_psu: [[0, 10], [3, 30]]}}\n"
    (tmp_path / "salty.yaml").write_text(salty)
    musselbed("run worst.yaml --time asap --out worst-before")
    musselbed("run whole.yaml --time asap --out before")
    assert "salinity_psu: unknown key" in musselbed("run salty.yaml --time asap --out refused", code=2)

    install("sensor", tmp_path / "sensor", environment | {"PIP_NO_INDEX": "1"}, options=BOAT_OPTION)
    musselbed("run salty.yaml --time asap --out run")
    samples = [json.loads(line) for line in (tmp_path / "run/samples.jsonl").read_text().splitlines()]
    assert len(samples) >= 5 and len({it["salinity_psu"] for it in samples}) > 1
    for it in samples:
        # Each lies at 3 m. A noise is within 4.9 deviations of 0.02, and a count is 0.001.
        assert it["salinity_psu"] == pytest.approx(30.0, abs=4.9 * 0.02 + 0.0005)
        assert it["salinity_psu"] == pytest.approx(-1.0 + 0.001 * it["counts"][4], abs=1e-9)
    for it in json.loads(musselbed("mu energy run --json")):
        # 60 mW of a battery of 7.4 Wh, for as long as the sensors are on.
        hours = it["state_hours"].get("sampling", 0) + it["state_hours"].get("reporting", 0)
        assert hours > 0 and it["is_exact"]
        assert it["by_module"]["salinity"] == pytest.approx(0.060 * hours / 7.4, rel=1e-4)
    musselbed("report run")
    assert "salinity" in (tmp_path / "report/report.html").read_text()
    assert musselbed("check run") == "run: all rules hold\n"
    assert "lab_sensors 1.2: sensors salinity" in musselbed("doctor --all || true")
    versions = json.loads((tmp_path / "run/versions.json").read_text())
    assert versions["packages_of_others"] == {"lab_sensors 1.2": "sensors salinity"}
    # Boards of the worst case take no samples, so their runs are read on; those of whole boards are refused.
    assert musselbed("check worst-before") == "worst-before: all rules hold\n"
    # A run of a version that kept no list was flown without them, too.
    its_scenario = tmp_path / "before/scenario.yaml"
    for text in (its_scenario.read_text(), its_scenario.read_text().replace("sensors: []\n", "")):
        its_scenario.write_text(text)
        assert musselbed("check before", code=2) == (
            "musselbed check: before/scenario.yaml: sensors: flown without the sensor salinity of lab_sensors 1.2, "
            "which is installed here: uninstall it\n"
        )
    assert "sensors:" not in text

    (tmp_path / "where.py").write_text("import lab_sensors\nprint(lab_sensors.__file__)\n")
    module = Path(musselbed("python where.py").strip())
    text = module.read_text()
    module.write_text("import nowhere\n")
    broken = (
        "the sensor salinity of lab_sensors 1.2 (lab_sensors:SALINITY) cannot be loaded: ModuleNotFoundError"
    )
    for words in ("run whole.yaml", "check run"):
        (line,) = musselbed(words, code=2).splitlines()
        assert broken in line and "uninstall it" in line
    assert f"FAIL sensors: {broken}" in musselbed("doctor || true")
    module.write_text(text)

    musselbed("python -m pip uninstall --yes lab_sensors")
    lacks = "run/scenario.yaml: sensors: flown with the sensor salinity of lab_sensors 1.2, which is not installed here"
    for words in ("check", "replay", "branch --at 300 --set batch=2"):
        (line,) = musselbed(f"{words} run", code=2).splitlines()
        assert lacks in line
    options = json.loads((tmp_path / "run/run.json").read_text())
    (tmp_path / "run/run.json").write_text(json.dumps(options | {"time": "wall"}))
    (tmp_path / "run/summary.json").unlink()
    assert lacks in musselbed("resume run", code=2)
    musselbed("export run --to csv")
    with (tmp_path / "run/export-csv/samples.csv").open() as file:
        assert [float(it["salinity_psu"]) for it in csv.DictReader(file)] == [
            it["salinity_psu"] for it in samples
        ]
