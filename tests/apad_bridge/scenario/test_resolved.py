"""The resolved scenario, written back as YAML, loads as the same scenario, also from a directory that was moved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE, SCENARIO_FILES

from apad_bridge.scenario.blocks.mission_options import DockingProfile
from apad_bridge.scenario.loader import from_data, load, resolve, write_resolved
from apad_bridge.scenario.schema import Scenario

POOL = load(POOL_FILE)


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    low = draw(st.floats(0, 1))
    data = resolve(POOL)
    data["seed"] = draw(st.integers(0, 2**63 - 1))
    data["theta"] = draw(st.integers(1, 10**6))
    data["description"] = draw(st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"])))
    data["fleet"]["start"] = {"charge": [low, draw(st.floats(low, 1))]}
    data["fleet"]["drift"]["amplitude_m"] = draw(st.floats(0, 100))
    data["mission"]["docking"]["profile"] = draw(
        st.sampled_from([profile.value for profile in DockingProfile])
    )
    data["mission"]["speed_m_s"] = draw(st.floats(1e-6, 1))
    data["apad"]["start_m"] = [draw(st.floats(-1e4, 1e4)), draw(st.floats(-1e4, 1e4))]
    data["records"]["truth_on_agent_topics"] = draw(st.booleans())
    return from_data(data, "drawn")


@settings(deadline=None)
@given(scenarios())
def test_a_written_scenario_is_the_same_scenario(
    tmp_path_factory: pytest.TempPathFactory, scenario: Scenario
) -> None:
    path = tmp_path_factory.mktemp("run") / "scenario.yaml"
    write_resolved(path, scenario)
    assert load(path) == scenario


def test_defaults_are_written_out_and_nothing_else_is_left_behind(tmp_path: Path) -> None:
    write_resolved(tmp_path / "scenario.yaml", POOL)
    assert [path.name for path in tmp_path.iterdir()] == ["scenario.yaml"]
    written = yaml.safe_load((tmp_path / "scenario.yaml").read_text())
    assert written["mission"]["costs"] == {"distance_per_m": 1.0, "energy_per_charge": 1.0, "flow": True}
    assert written["fleet"]["start"] == str(SCENARIO_FILES / "pool.csv")


def test_a_run_that_holds_its_own_starts_can_be_moved(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    (first / "starts.csv").write_text((SCENARIO_FILES / "pool.csv").read_text())
    write_resolved(
        first / "scenario.yaml", replace(POOL, fleet=replace(POOL.fleet, start=str(first / "starts.csv")))
    )
    first.rename(second)
    assert load(second / "scenario.yaml").fleet.start == str(second / "starts.csv")
