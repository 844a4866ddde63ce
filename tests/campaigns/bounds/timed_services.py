"""Whole boards whose services skip wakes: a script docks each board before its alarm, and releases it after it."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

from apad_bridge.mission.script_values import Refused
from apad_bridge.records.uptime_figures import uptime_figures
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.loader import from_data, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.api import Api
from apad_bridge.scripting.program import ScriptSource
from apad_bridge.scripting.rendezvous import AS_FAST_AS_POSSIBLE
from apad_bridge.supervisor.run_spec import RunSpec

LEAD = "lead_s"
"""A key of these tries alone: the mission seconds before an alarm at which the first aMussel is fetched."""
DRAWS: dict[str, Callable[[Random], Any]] = {
    LEAD: lambda random: random.choice((5.0, 10.0, 14.0, 20.0, 30.0, 60.0)),
    "stay_s": lambda random: random.choice((1.0, 3.0, 10.0, 30.0)),
    "theta": lambda random: random.choice((5, 10, 30)),
    "agent_hours": lambda random: random.choice((10, 24, 48)),
    "count": lambda random: random.randint(1, 4),
    "docks": lambda random: random.randint(1, 4),
    "alarm_s": lambda random: random.choice((1200.0, 3600.0)),
    "awake_part": lambda random: round(random.uniform(0.02, 0.6), 3),
    "motor_run_s": lambda random: random.choice((1.0, 10.0, 60.0)),
    "start": lambda random: round(random.uniform(0.05, 1.0), 3),
    "seed": lambda random: random.randint(1, 10**6),
}


def scenario_of(drawn: dict[str, Any], whole: Scenario) -> Scenario:
    """The whole boards' scenario with these keys, on a square metre."""
    data = resolve(whole)
    data["area"]["polygon_m"] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    data["duration_s"] = float(drawn["agent_hours"] * 3600 // drawn["theta"])
    data |= {"theta": drawn["theta"], "seed": drawn["seed"]}
    data["fleet"] |= {"count": drawn["count"], "agent_ids": [], "start": {"charge": [drawn["start"]] * 2}}
    data["apad"] |= {"start_m": [0.5, 0.5], "profile": None, "docks": drawn["docks"]}
    data["apad"]["battery"]["capacity_wh"] = 1e7
    data["board"]["profile"] = None
    data["board"]["whole"]["cycle"] |= {
        "profile": None,
        "alarm_s": drawn["alarm_s"],
        "processing_s": drawn["alarm_s"] * drawn["awake_part"],
    }
    data["board"]["whole"]["power"] |= {"profile": None, "motor_run_s": drawn["motor_run_s"]}
    data["hearing"]["report_period_s"] = 1.0
    data["mission"]["batch"] = 1
    data["mission"]["docking"] |= {"dock_s": 1.0, "undock_s": 0.0}
    return from_data(data, "a try")


def uptime_of(drawn: dict[str, Any], scenario: Scenario) -> float:
    """The mean uptime of its flight, in percent. RuntimeError if the script ends by an error."""
    whole = scenario.board.whole
    assert whole is not None and whole.cycle is not None
    period_s, ids = whole.cycle.alarm_s / scenario.theta, scenario.fleet.ids

    def before_each_alarm(api: Api) -> None:
        while True:
            alarm_s = (int((api.now() + drawn[LEAD]) // period_s) + 1) * period_s
            api.sleep(max(1.0, alarm_s - drawn[LEAD] - api.now()))
            docked = [
                id
                for id, dock in zip(sorted(ids, key=api.battery), api.free_docks(), strict=False)
                if _collected(api, id, dock)
            ]
            api.sleep(max(1.0, alarm_s + drawn["stay_s"] - api.now()))
            for id in docked:
                api.deploy(id)

    source = ScriptSource(scenario, before_each_alarm, "timed", lambda _: None, AS_FAST_AS_POSSIBLE)
    flight, recorder = open_flight(scenario, RunSpec(command_sources=(source,)))
    flight.run()
    source.join()
    if source.error is not None:
        raise RuntimeError(f"{drawn}: {source.error}") from source.error
    figures = uptime_figures(recorder.meter, flight.now_ms, battery_min=recorder.battery_min)
    return float(figures["uptime_paper"]["mean"])


def _collected(api: Api, id: int, dock: int) -> bool:
    try:
        return api.collect(id, dock)
    except Refused:
        return False  # it is lost
