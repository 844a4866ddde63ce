"""`musselbed layout KIND SCENARIO`: write a layout with which RViz, rqt or Foxglove shows a fleet."""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.text.text_file import write_atomically
from apad_bridge.viewers.layouts.kinds import KINDS
from apad_bridge.viewers.layouts.layout_content import layout_fleet

_NAMESPACE = re.compile(r"/?[A-Za-z]\w*(/[A-Za-z]\w*)*/?")


def add_parser(commands: Any) -> None:
    opened = "; ".join(f"{name}: {kind.opened}" for name, kind in KINDS.items())
    parser = commands.add_parser(
        "layout",
        description="Writes a layout for a scenario's aPads and aMussels, to stdout or a file. launch_scripts/layouts "
        "holds those of pool-12. Other aMussels, other ids, several aPads or a namespace need their own.",
        epilog=ending(
            "musselbed layout rviz launch_scripts/scenarios/bay-120.yaml --out bay-120.rviz",
            "musselbed layout foxglove launch_scripts/scenarios/pool-12.yaml --namespace bay",
            note=f"To open it: {opened}. See docs/ros-tools.md.",
        ),
    )
    parser.add_argument("kind", choices=list(KINDS), help="the program that opens it")
    parser.add_argument("scenario", type=Path, metavar="SCENARIO.yaml")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write this file (default: to stdout)")
    parser.add_argument("--force", action="store_true", help="replace FILE if it exists")
    parser.add_argument(
        "--namespace",
        default="",
        metavar="NS",
        help="ROS namespace of the fleet's nodes, as <group ns=NS> in a launch file",
    )
    parser.add_argument(
        "--json", action="store_true", help="print a JSON object: kind, and the file or the layout's text"
    )


def run(arguments: argparse.Namespace) -> int:
    out: Path | None = arguments.out
    text = _layout_text(arguments)
    if out is not None:
        _save(out, text, force=arguments.force)
    if arguments.json:
        result = {"text": text} if out is None else {"file": str(out), "bytes": len(text.encode())}
        print(json.dumps({"kind": arguments.kind, **result}))
    else:
        print(text if out is None else out, end="" if out is None else "\n")
    return Exit.DONE


def _layout_text(arguments: argparse.Namespace) -> str:
    namespace: str = arguments.namespace
    if namespace.strip("/") and not _NAMESPACE.fullmatch(namespace):
        raise UserError(
            f"--namespace {namespace}: names of letters, digits and _ with / between, as bay/north"
        )
    scenario = load(arguments.scenario)
    fleet = layout_fleet(scenario, starts_of(scenario), f"/{namespace.strip('/')}".rstrip("/"))
    return KINDS[arguments.kind].write(fleet)


def _save(out: Path, text: str, *, force: bool) -> None:
    if out.is_dir():
        raise UserError(f"--out {out}: is a directory: name a file in it")
    if out.exists() and not force:
        raise UserError(f"--out {out} exists already: replace it with --force")
    write_atomically(out, text)
