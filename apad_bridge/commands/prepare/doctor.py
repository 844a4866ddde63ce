"""`musselbed doctor`: checks this machine, its network and a scenario, and prints a line for each with the mend."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apad_bridge.commands.help_text import ending
from apad_bridge.commands.trust import add_trust_argument, trust_of_looked_at
from apad_bridge.doctor import graph_checks, interpreter, machine, network, scenario_check
from apad_bridge.doctor.finding import CheckStatus, Finding, fail, ok, run_check, run_checks, warn
from apad_bridge.ros_names.names import in_full
from apad_bridge.runs.exits import Exit

if TYPE_CHECKING:
    from apad_bridge.assembly.division import Member
    from apad_bridge.planning.registry import Trust
    from apad_bridge.scenario.schema import Scenario


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "doctor",
        description="Checks the needs of a run, and prints a line for each check that is not OK: WARN, FAIL or CANNOT "
        "TELL, the finding, and what to do. It changes nothing: for the test of the way back it registers with the master "
        "at ROS_MASTER_URI, and unregisters at once. Without a master it skips these checks, because `musselbed run` "
        "starts its own.",
        epilog=ending(
            "musselbed doctor",
            "musselbed doctor launch_scripts/scenarios/real-apad.yaml",
            note="The doctor ends with 0 when nothing FAILs, with 2 when the scenario alone does, and else with 3.",
        ),
    )
    parser.add_argument(
        "scenario", type=Path, nargs="?", metavar="SCENARIO.yaml", help="check this scenario and its ids, too"
    )
    add_trust_argument(parser)
    parser.add_argument("--all", action="store_true", help="print the checks that are OK, too")
    parser.add_argument(
        "--json", action="store_true", help="print a JSON list of {check, status, found, mend} on stdout"
    )


def run(arguments: argparse.Namespace) -> int:
    failed: set[str] = set()
    findings = []
    for finding in diagnose(
        arguments.scenario, os.environ.get("ROS_MASTER_URI", ""), trust=trust_of_looked_at(arguments)
    ):
        if finding.status is CheckStatus.FAIL:
            failed.add(finding.check)
        findings.append(asdict(finding))
        if not arguments.json and (arguments.all or finding.status is not CheckStatus.OK):
            print(finding.line(), flush=True)
    if arguments.json:
        print(json.dumps(findings, indent=1))
    else:
        fine = sum(it["status"] is CheckStatus.OK for it in findings)
        print(f"{fine} of {len(findings)} checks are OK" + ("" if arguments.all else "; --all prints them"))
    if failed == {"scenario"}:
        return Exit.USER_MISTAKE
    return Exit.PEER_FAILED if failed else Exit.DONE


def diagnose(scenario_file: Path | None, master_uri: str, trust: Trust | None = None) -> Iterator[Finding]:
    """All checks, in an order in which the first FAIL is the one to mend first.

    Strategies in files are executed with `trust` alone, and otherwise named as left out.
    """
    yield from run_checks(interpreter.CHECKS, None)
    scenario: Scenario | None = None
    if scenario_file is not None:
        scenario, findings = scenario_check.read(scenario_file, trust)
        yield from findings
    agents = machine.AGENTS_BY_DEFAULT if scenario is None else scenario.fleet.count
    yield from run_checks(machine.CHECKS, agents)
    yield from check_ros(master_uri, scenario)


def check_ros(
    master_uri: str,
    scenario: Scenario | None,
    mapping: Mapping[str, str] | None = None,
    flown: Sequence[Member] = (),
) -> Iterator[Finding]:
    """ROS here, the network both ways, and the aPads on the master; an empty URI for none.

    `mapping` are a run's remappings, from name to name in full. A mission is about to begin with the aPads `flown`: the
    checks before one follow.
    """
    try:
        from apad_bridge.doctor.apad_checks import check_apads, check_place
        from apad_bridge.doctor.live_apad import LiveAPad
        from apad_bridge.ros import doctor_checks
        from apad_bridge.ros.door import DOOR
    except ImportError as error:
        yield fail(f"cannot be imported: {error}", interpreter.INSTALL, check="ROS")
        return
    yield from run_checks(doctor_checks.CHECKS, None)
    if not master_uri:
        yield ok(
            "ROS_MASTER_URI is not set, so the checks that need a master were skipped: `musselbed run` starts its own; "
            "for an aPad's, export ROS_MASTER_URI=http://HOST:11311",
            check="master",
        )
        return
    try:
        found = graph_checks.Graph.read(master_uri).remapped(mapping or {})
    except network.Unreachable as error:
        yield _unreachable_master(master_uri, error)
        return
    yield ok(f"{master_uri} answers; {len(found.nodes)} nodes on it", check="master")
    host, bind = doctor_checks.announced_host(), doctor_checks.bind_address()
    namespace = os.environ.get("ROS_NAMESPACE", "").strip("/")
    ids = None if scenario is None else scenario.fleet.ids
    yield from run_checks(graph_checks.CHECKS, graph_checks.MasterSeen(found, host, bind, ids, namespace))
    names = {in_full(namespace, it.scenario.apad.name): it for it in flown}
    yield from run_check("aPad", lambda: check_apads(DOOR, found, scenario, names))
    if scenario is not None:
        for name in scenario.apad_names:
            apad = LiveAPad(DOOR, found, in_full(namespace, name))
            yield from run_check("origin", partial(check_place, apad, scenario.area.origin), apad.name)
    if flown:
        yield from _check_before_mission(found, names, namespace)


def _check_before_mission(
    found: graph_checks.Graph, flown: Mapping[str, Member], namespace: str
) -> Iterator[Finding]:
    from apad_bridge.doctor import preflight_checks
    from apad_bridge.ros.door import DOOR

    yield from run_checks(preflight_checks.CHECKS_OF_WAY, found)
    for name, member in flown.items():
        apad = preflight_checks.WatchedAPad(DOOR, found, name, member.scenario, member.starts, namespace)
        yield from run_checks(preflight_checks.CHECKS, apad, name)


def _unreachable_master(uri: str, error: network.Unreachable) -> Finding:
    """A master on another machine is an aPad's and has to answer; on this machine `musselbed run` brings its own."""
    found = f"none at {uri}, and what needs one was not checked: {error}"
    if network.is_loopback(uri):
        return warn(
            found,
            "nothing to mend for `musselbed run`, which starts its own; for others: start roscore",
            check="master",
        )
    return fail(
        found,
        "see that its machine is on, that its host is in /etc/hosts, and that its roscore runs; to fly without it: "
        "unset ROS_MASTER_URI",
        check="master",
    )
