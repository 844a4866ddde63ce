"""`musselbed bridge SCENARIO.yaml PORT`: real aMussels by a nanomodem, Wi-Fi or an aPad's modem, for a mission on ROS."""

from __future__ import annotations

import argparse
import json
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

from agents.hosting import interrupts
from agents.time_scale import MissionMs
from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "bridge",
        description="Carries packets between real aMussels and a mission on ROS, by a V3 nanomodem on a serial port, by "
        "datagrams (UDP), or by the topics of an aPad's modem. It claims the aMussels as real, so that no fleet simulates "
        "them; they stay real when it ends. A cable that is pulled out is told, and its port is tried again.",
        epilog=ending(
            "musselbed bridge runs/pool-12-1 /dev/ttyUSB0 --ids 3 7",
            "musselbed bridge sound-12 /dev/ttyUSB0 udp:10.0.0.2:5005 --ids 3 --codec ours-2",
            note="It runs until Ctrl-C, on the run's master, or for a scenario on that at ROS_MASTER_URI. What a node must "
            "transmit, byte by byte: docs/mixing.md.",
        ),
    )
    parser.add_argument(
        "scenario",
        type=Path,
        metavar="RUN|SCENARIO.yaml",
        help="the directory of the run that flies, or the scenario of the mission at ROS_MASTER_URI",
    )
    parser.add_argument(
        "ports",
        nargs="+",
        metavar="PORT",
        help="the modem's serial port, udp:PORT on loopback, udp:ADDRESS:PORT, or a file as "
        "launch_scripts/interfaces/nodes.yaml; one by sound, and one by Wi-Fi",
    )
    parser.add_argument(
        "--ids", type=int, nargs="+", metavar="N", help="the real aMussels (default: the whole fleet)"
    )
    parser.add_argument(
        "--codec",
        metavar="NAME",
        help="the installed codec of the nodes, where they have other bytes than the scenario's; on a serial port their "
        "packets then have no header",
    )
    parser.add_argument(
        "--json", action="store_true", help="print each line for a person, and the counts, as JSON"
    )


def run(arguments: argparse.Namespace) -> int:
    from apad_bridge.scenario.firmware_config import codec_of
    from apad_bridge.scenario.loader import load
    from apad_bridge.scenario.water.water_options import Water
    from firmware_model.packets.codec import load_codec

    run_dir: Path | None = arguments.scenario if arguments.scenario.is_dir() else None
    scenario = load(arguments.scenario if run_dir is None else run_dir / "scenario.yaml")
    ids = arguments.ids or list(scenario.fleet.ids)
    if strangers := sorted(set(ids) - set(scenario.fleet.all_ids)):
        known = f"{scenario.fleet.all_ids[0]} to {scenario.fleet.all_ids[-1]}"
        raise UserError(f"--ids {strangers[0]}: the scenario's aMussels are {known}")
    try:
        nodes_codec = None if arguments.codec is None else load_codec(arguments.codec)
    except ValueError as error:
        raise UserError(f"--codec {arguments.codec}: {error}") from None

    def tell(kind: str, text: str) -> None:
        line = json.dumps({kind: text}) if arguments.json else text
        print(line, flush=True)

    from apad_bridge.ros.amussel_bridge import AMusselBridge
    from apad_bridge.ros.node_links import open_links
    from apad_bridge.ros.system.route import enter_graph_of
    from apad_bridge.supervisor.clock import StopSign

    stop = StopSign()
    links = open_links(
        arguments.ports,
        scenario.apad.name,
        ids,
        has_header=nodes_codec is None,
        sound_speed_m_s=(scenario.water or Water()).sound.sound_speed_m_s,
    )
    with interrupts.received_by(stop.set):
        if run_dir is not None and not enter_graph_of(run_dir, stop.wait):
            return Exit.INTERRUPTED
        begun_s = time.monotonic()
        bridge = AMusselBridge.on_graph(ids, codec_of(scenario), links, tell, nodes_codec)
        with closing(bridge):
            tell(
                "ready",
                f"{', '.join(it.name for it in links)}; claims aMussels {', '.join(map(str, ids))} as real",
            )
            while not stop.is_set():
                bridge.advance(MissionMs(round(1000 * (time.monotonic() - begun_s))))
    if arguments.json:
        print(json.dumps({"counts": bridge.counts}), flush=True)
    else:
        for what, count in sorted(bridge.counts.items()):
            print(f"{count:6d}  {what}", file=sys.stderr)
    return Exit.INTERRUPTED
