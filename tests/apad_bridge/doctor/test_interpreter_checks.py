"""Python, its packages, and other people's packages with names of ours."""

from __future__ import annotations

import sys
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path

import pytest

from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.doctor.interpreter import (
    check_numpy,
    check_packages,
    check_pinned,
    check_python,
    check_shadows,
)


@pytest.fixture
def environment(tmp_path: Path) -> Path:
    (tmp_path / "pyvenv.cfg").write_text("home = /usr/bin\ninclude-system-site-packages = false\n")
    return tmp_path


DEBIANS = Path("/usr/bin/python3")


@pytest.mark.parametrize(
    ("python", "config", "path", "status", "told"),
    [
        (DEBIANS, "", None, "OK", ""),
        (Path("python3"), "", None, "FAIL", "launch_scripts/install"),
        (DEBIANS, "", ["."], "FAIL", "rospy"),
        (DEBIANS, "include-system-site-packages = true\n", None, "WARN", "launch_scripts/install"),
    ],
    ids=["Debian's", "another does not see rospy", "hides Debian's ROS", "sees all of Debian's packages"],
)
def test_a_python_sees_debians_ros_and_no_other_packages(
    environment: Path,
    monkeypatch: pytest.MonkeyPatch,
    python: Path,
    config: str,
    path: list[str] | None,
    status: str,
    told: str,
) -> None:
    (environment / "python3").touch()
    if config:
        (environment / "pyvenv.cfg").write_text(config)
    if path is not None:
        monkeypatch.setattr(sys, "path", [str(environment)])
    (finding,) = check_python(environment / python, environment, DEBIANS)
    assert finding.status == status and told in f"{finding.found} {finding.mend}"
    assert python.is_absolute() or str(environment / python) in finding.found


@pytest.mark.parametrize(
    ("version", "python", "status", "told"),
    [
        ("1.26.3", (3, 13), "FAIL", ""),
        ("1.26.4", (3, 13), "OK", ""),
        ("2.2.6", (3, 13), "OK", ""),
        ("2.3", (3, 13), "FAIL", ""),
        ("2.3.0rc1", (3, 13), "FAIL", ""),
        ("3.0", (3, 13), "FAIL", ""),
        # Python 3.14 has a numpy that some publishers cannot use.
        ("2.4.6", (3, 14), "WARN", "rospy.numpy_msg"),
    ],
)
def test_numpy_must_go_with_debians_rospy(
    version: str, python: tuple[int, int], status: str, told: str
) -> None:
    found = check_numpy(version, python)
    assert found.status == status and told in found.found


def test_what_a_distribution_asks_for_and_does_not_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "lab-1.0.dist-info"
    info.mkdir()
    requirements = (
        "Requires-Dist: surely-not-here>=1\nRequires-Dist: numpy<2.3\nRequires-Dist: nor-this; extra == 'x'\n"
        'Requires-Dist: of-another-python; python_version < "3.11"\n'
        'Requires-Dist: of-a-later-one; python_version >= "3.99"\n'
        'Requires-Dist: of-this-one; python_version >= "3.11"\n'
    )
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n{requirements}")
    monkeypatch.syspath_prepend(str(tmp_path))
    found = {finding.check: finding.status for finding in check_packages("lab")}
    assert found == {
        "surely-not-here": CheckStatus.FAIL,
        "numpy": CheckStatus.OK,
        "of-this-one": CheckStatus.FAIL,
    }


def test_an_environment_without_the_distribution() -> None:
    (finding,) = check_packages("surely-not-here")
    assert finding.status is CheckStatus.FAIL and "launch_scripts/install" in str(finding.mend)


class Places:
    """Makes a clone, and another package called `agents` in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.root, self.other, self.empty = folder / "clone", folder / "other", folder / "empty"
        for name in ("agents", "apad_bridge", "firmware_model"):
            (self.root / name).mkdir(parents=True)
            (self.root / name / "__init__.py").touch()
        (self.other / "agents").mkdir(parents=True)
        (self.other / "agents" / "__init__.py").touch()
        self.module = folder / "module"
        for it in (self.empty, self.module):
            it.mkdir()
        (self.module / "firmware_model.py").touch()

    def status(self, *path: Path, here: Path) -> dict[str, str]:
        findings = check_shadows([str(entry) for entry in path], self.root, here)
        return {finding.check: f"{finding.status} {finding.found} {finding.mend}" for finding in findings}


@pytest.fixture
def places(tmp_path: Path) -> Places:
    return Places(tmp_path)


@pytest.mark.parametrize(
    ("path", "here", "package", "status", "told"),
    [
        (["root", "empty"], "empty", "agents", "OK", []),
        (["root", "empty"], "empty", "firmware_model", "OK", []),
        (
            ["other", "root"],
            "empty",
            "agents",
            "FAIL",
            ["take {other} off PYTHONPATH", "{other}", "{root}/agents"],
        ),
        (["other", "root"], "empty", "firmware_model", "OK", []),
        (["root", "other"], "empty", "agents", "WARN", []),
        (["root"], "other", "agents", "FAIL", ["in another folder"]),
        (["root"], "module", "firmware_model", "FAIL", []),
    ],
)
def test_another_package_of_our_name_is_told_where_it_comes_before_ours(
    places: Places,
    monkeypatch: pytest.MonkeyPatch,
    path: list[str],
    here: str,
    package: str,
    status: str,
    told: list[str],
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(places.other))
    found = places.status(*(getattr(places, it) for it in path), here=getattr(places, here))[package]
    assert found.startswith(status) and all(it.format(**vars(places)) in found for it in told)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The packages of an environment, with an empty workspace before them on the path."""
    site, workspace = tmp_path / "site", tmp_path / "workspace"
    for file in (site / "lab_plots/__init__.py", site / "lab_tool.py"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    workspace.mkdir()
    for folder in (site, workspace):
        monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", str(workspace))
    return site


@pytest.mark.parametrize("shadows", [[], ["lab_tool/__init__.py", "lab_plots.py"]])
def test_what_a_workspace_shadows_is_named_with_the_workspace(
    site: Path, tmp_path: Path, shadows: list[str]
) -> None:
    workspace = tmp_path / "workspace"
    for name in shadows:
        (workspace / name).parent.mkdir(exist_ok=True)
        (workspace / name).touch()
    (finding,) = check_pinned(site)
    assert finding.status is (CheckStatus.FAIL if shadows else CheckStatus.OK)
    assert not shadows or f"lab_plots, lab_tool would be imported from {workspace}" in finding.found
    assert finding.mend == (f"take {workspace} off PYTHONPATH" if shadows else None)


def test_what_another_package_claimed_as_the_interpreter_began_is_named(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a .pth file does: that of Debian's matplotlib puts its own mpl_toolkits into sys.modules."""
    claimed = tmp_path / "debian"
    (claimed / "lab_plots").mkdir(parents=True)
    (claimed / "lab_plots/__init__.py").touch()
    spec = PathFinder.find_spec("lab_plots", [str(claimed)])
    assert spec
    monkeypatch.setitem(sys.modules, "lab_plots", module_from_spec(spec))
    (finding,) = check_pinned(site)
    assert (
        finding.status is CheckStatus.FAIL and f"lab_plots would be imported from {claimed}" in finding.found
    )


def test_nothing_is_shadowed_in_the_environment_of_these_tests() -> None:
    assert [it.found for it in check_pinned() if it.status is not CheckStatus.OK] == []
