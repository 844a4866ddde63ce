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


def test_debians_python_in_an_environment_that_sees_its_ros(environment: Path) -> None:
    (finding,) = check_python(Path("/usr/bin/python3"), environment, Path("/usr/bin/python3"))
    assert finding.status is CheckStatus.OK


def test_another_python_does_not_see_rospy(environment: Path) -> None:
    other = environment / "python3"
    other.touch()
    (finding,) = check_python(other, environment, Path("/usr/bin/python3"))
    assert finding.status is CheckStatus.FAIL
    assert str(other) in finding.found and "launch_scripts/install" in str(finding.mend)


def test_an_environment_that_hides_debians_ros(environment: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(environment)])
    (finding,) = check_python(Path("/usr/bin/python3"), environment, Path("/usr/bin/python3"))
    assert finding.status is CheckStatus.FAIL and "rospy" in finding.found


def test_an_environment_that_sees_all_of_debians_packages(environment: Path) -> None:
    (environment / "pyvenv.cfg").write_text("include-system-site-packages = true\n")
    (finding,) = check_python(Path("/usr/bin/python3"), environment, Path("/usr/bin/python3"))
    assert finding.status is CheckStatus.WARN and "launch_scripts/install" in str(finding.mend)


@pytest.mark.parametrize(
    ("version", "status"),
    [
        ("1.26.3", "FAIL"),
        ("1.26.4", "OK"),
        ("2.2.6", "OK"),
        ("2.3", "FAIL"),
        ("2.3.0rc1", "FAIL"),
        ("3.0", "FAIL"),
    ],
)
def test_numpy_must_go_with_debians_rospy(version: str, status: str) -> None:
    assert check_numpy(version, (3, 13)).status == status


def test_python_3_14_has_a_numpy_that_some_publishers_cannot_use() -> None:
    found = check_numpy("2.4.6", (3, 14))
    assert found.status == CheckStatus.WARN and "rospy.numpy_msg" in found.found


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
        self.empty.mkdir()

    def status(self, *path: Path, here: Path | None = None) -> dict[str, str]:
        findings = check_shadows([str(entry) for entry in path], self.root, here or self.empty)
        return {finding.check: f"{finding.status} {finding.found} {finding.mend}" for finding in findings}


@pytest.fixture
def places(tmp_path: Path) -> Places:
    return Places(tmp_path)


def test_alone_on_the_path(places: Places) -> None:
    assert all(line.startswith("OK") for line in places.status(places.root, places.empty).values())


def test_another_agents_that_comes_before_ours(places: Places, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(places.other))
    found = places.status(places.other, places.root)
    assert found["agents"].startswith("FAIL") and f"take {places.other} off PYTHONPATH" in found["agents"]
    assert str(places.other) in found["agents"] and str(places.root / "agents") in found["agents"]
    assert found["firmware_model"].startswith("OK")


def test_another_agents_that_comes_later_is_only_said(places: Places) -> None:
    assert places.status(places.root, places.other)["agents"].startswith("WARN")


def test_another_agents_in_the_folder_that_a_run_starts_in(places: Places) -> None:
    found = places.status(places.root, here=places.other)
    assert found["agents"].startswith("FAIL") and "in another folder" in found["agents"]
    (places.empty / "firmware_model.py").touch()
    assert places.status(places.root)["firmware_model"].startswith("FAIL")


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


def test_the_environments_own_packages_are_imported(site: Path) -> None:
    (finding,) = check_pinned(site)
    assert finding.status is CheckStatus.OK


def test_what_a_workspace_shadows_is_named_with_the_workspace(site: Path, tmp_path: Path) -> None:
    workspace = tmp_path / "workspace"
    (workspace / "lab_tool").mkdir()
    for name in ("lab_tool/__init__.py", "lab_plots.py"):
        (workspace / name).touch()
    (finding,) = check_pinned(site)
    assert finding.status is CheckStatus.FAIL
    assert f"lab_plots, lab_tool would be imported from {workspace}" in finding.found
    assert finding.mend == f"take {workspace} off PYTHONPATH"


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
