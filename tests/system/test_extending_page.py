"""docs/extending.md, followed as printed: its packages are written, installed by its command, and flown."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
STRATEGIES, _, CODECS = (ROOT / "docs" / "extending.md").read_text().partition("\n## Codecs\n")
POOL = ROOT / "launch_scripts" / "scenarios" / "pool-12.yaml"


def block(page: str, name: str) -> str:
    """The fenced block that follows the line which names the file."""
    found = re.search(rf"`{re.escape(name)}`:\n\n```\w*\n(.*?)```", page, re.DOTALL)
    assert found, f"docs/extending.md shows no {name}"
    return found[1]


def command() -> str:
    found = re.search(r"^```sh\n(.*?)^```", STRATEGIES, re.DOTALL | re.MULTILINE)
    assert found
    return found[1]


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """A shell's variables in which `musselbed` is on PATH, in an environment that may be changed.

    It has all that musselbed's own environment has.
    """
    place = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", place], check=True, timeout=60)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    beside = sysconfig.get_path("purelib")
    debian = "/usr/lib/python3/dist-packages"
    lines = "".join(f"import site; site.addsitedir({folder!r})\n" for folder in (beside, debian))
    (place / "lib" / version / "site-packages" / "beside.pth").write_text(lines)
    program = place / "bin" / "musselbed"
    program.write_text(
        f"#!{place}/bin/python\nfrom apad_bridge.commands.main import main\nraise SystemExit(main())\n"
    )
    program.chmod(0o755)
    return {
        **os.environ,
        "PATH": f"{os.environ['PATH']}:{place}/bin".replace(f"{Path(sys.executable).parent}:", ""),
    }


def in_a_shell(script: str, folder: Path, environment: dict[str, str]) -> str:
    done = subprocess.run(
        ["bash", "-eu", "-c", script],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def install(page: str, module: str, folder: Path, environment: dict[str, str]) -> None:
    folder.mkdir()
    for name in (f"{module}.py", "setup.cfg"):
        (folder / name).write_text(block(page, name))
    (folder / "pyproject.toml").write_text(block(STRATEGIES, "pyproject.toml"))
    in_a_shell(command(), folder, environment)


def test_both_packages_of_the_page_install_and_fly(tmp_path: Path, environment: dict[str, str]) -> None:
    install(STRATEGIES, "lab_strategies", tmp_path / "strategies", environment)
    install(CODECS, "lab_codec", tmp_path / "codec", environment)
    scenario = tmp_path / "lines.yaml"
    text = POOL.read_text().replace("hearing: {", "hearing: {codec: lines, ")
    scenario.write_text(text)
    (tmp_path / "pool-12.csv").write_text(POOL.with_suffix(".csv").read_text())
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
