"""The replay page's own scripts, linted as the one script that a page has of them."""

import json
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

from apad_bridge.analysis.replay.build import SCRIPTS

RULES = ("no-undef", "no-unused-vars", "no-redeclare", "eqeqeq", "prefer-const", "no-var")
CONFIGURATION = {
    "env": {"browser": True, "es2024": True},
    "globals": {"uPlot": "readonly"},
    "categories": {"correctness": "error"},
    "rules": dict.fromkeys(RULES, "error"),
}


def lint(script: str, folder: Path) -> subprocess.CompletedProcess[str]:
    path, configuration = folder / "page.js", folder / "oxlint.json"
    path.write_text(script)
    configuration.write_text(json.dumps(CONFIGURATION))
    command = [Path(sys.executable).with_name("oxlint"), "--config", configuration, "--deny-warnings", path]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


def test_the_scripts_pass_the_linter(tmp_path):
    whole = "".join((files("apad_bridge.analysis.replay") / name).read_text() for name in SCRIPTS)
    linted = lint(whole, tmp_path)
    assert linted.returncode == 0, linted.stdout
    # It would find what is nowhere defined, and what nobody uses.
    for mistake in ("nowhereDefined();", "const nobodyUses = 1;"):
        assert lint(f"{whole}\n(() => {{ {mistake} }})();\n", tmp_path).returncode == 1
