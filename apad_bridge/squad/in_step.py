"""Several aPads' flights in virtual time and in this process, tick by tick side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from apad_bridge.assembly import parts
from apad_bridge.assembly.division import Member
from apad_bridge.mission.breakdown import Breakdown
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs import flying
from apad_bridge.runs.nurseries import FOLDER
from apad_bridge.runs.progress import Shows
from apad_bridge.runs.several.assignment import Sharing
from apad_bridge.runs.several.lockstep import Flown, Formation
from apad_bridge.runs.status import Status
from apad_bridge.scenario.another_apad import Sharing as Rules
from apad_bridge.squad.exchange import Exchange
from apad_bridge.squad.together import together


def fly_in_step(
    members: Sequence[Member], rules: Rules, directories: Mapping[str, RunDirectory], progress: Shows
) -> tuple[dict[str, dict[str, Any]], int]:
    """By aPad the summaries; and how many aMussels were handed on to another one. SIGINT and SIGTERM end all in order."""
    served = {member.name: member.scenario.fleet.ids for member in members}
    exchange = Exchange(served)
    now: dict[str, Status] = {}

    def shown_as(name: str) -> Callable[[Status], None]:
        def show(status: Status) -> None:
            now[name] = status
            if name == members[-1].name:
                progress.show(together(list(now.values()), len(members)))

        return show

    with ExitStack() as stack:
        prepared, flown = {}, {}
        for member in members:
            name, scenario = member.name, member.scenario
            directory = directories[name]
            recorder = Recorder(directory, scenario, parts.agent_ids(scenario))
            stack.callback(recorder.close)
            flying.journal_start(recorder, scenario, member.starts)
            fleet = flying.open_fleet(scenario, member.starts, directory.path / FOLDER)
            stack.callback(fleet.host.close)
            surroundings = replace(
                flying.in_process(scenario, fleet),
                ether=exchange.ethers[name],
                tell_guest=exchange.ethers[name].felt,
                breakdown=Breakdown(rules.failed_go_tos),
            )
            prepared[name] = flying.prepare(scenario, surroundings, recorder, shown_as(name))
            flown[name] = Flown(scenario.apad.start_m, prepared[name].flight, recorder)
        formation = Formation(flown, exchange, Sharing(served) if rules.transfers else None)
        with flying.stopped_by_signals(*(it.flight for it in flown.values())):
            formation.run()
        return {name: it.finish() for name, it in prepared.items()}, formation.moved
