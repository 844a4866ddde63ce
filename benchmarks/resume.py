"""The cost of being able to resume: writing learned state to the checkpoint, and restoring it, against learning it."""

from __future__ import annotations

import random
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

from rich.console import Console
from rich.table import Table

from agents.time_scale import MissionMs
from apad_bridge.assembly import flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs
from apad_bridge.records.checkpoint import PERIOD_MS, ROWS, Checkpoint, restore
from apad_bridge.scenario.blocks.estimator_options import Beliefs, EstimatorKind, TwinModel
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import RandomStart, Scenario
from benchmarks.rows import told
from firmware_model.packets import StatusPacket
from firmware_model.states import State

SCENARIO = Path(__file__).parents[1] / "launch_scripts" / "scenarios" / "pool-12.yaml"
TWIN = TwinModel(
    drain_deviation=0.1, sensor_noise=0.01, bias_deviation=0.01, unscheduled=0.03, fix_deviation_m=1.0
)
CASES = (
    ("hold_last", 100, 1, 1),
    ("twin", 100, 1, 1),
    ("twin", 100, 30, 120),
    ("twin", 1000, 1, 1),
)
SHORT_CASES = 1
"""Estimator, aMussels, theta, seconds between an aMussel's packets: each second, or each hour of its own time."""


def measure(short: bool = False) -> dict[str, Any]:
    """Processor time, with a checkpoint file just before its next full write; `same`: the restored state is equal."""
    with tempfile.TemporaryDirectory() as folder:
        cases = CASES[:SHORT_CASES] if short else CASES
        return {"rows": [told(_measured(Path(folder) / "checkpoint.jsonl", *case)) for case in cases]}


def _measured(path: Path, estimator: str, agents: int, theta: int, period_s: int) -> dict[str, Any]:
    scenario = _scenario(estimator, agents, theta)
    plain, checkpointed = (
        flight_parts.initial_learned_state(flight_config(scenario)).beliefs for _ in range(2)
    )
    learning_s = _learn(plain, agents, theta, period_s)
    begun_s = process_time()
    checkpoint = Checkpoint(path, checkpointed, 0)
    writing_s = 0.0
    for packets, now_ms in _ticks(agents, theta, period_s):
        for packet in packets:
            checkpointed.hear(packet, MissionMs(now_ms))
        before_s = process_time()
        checkpoint.flush(now_ms)
        writing_s += process_time() - before_s
    checkpointing_s = process_time() - begun_s
    restored = flight_parts.initial_learned_state(flight_config(scenario)).beliefs
    before_s = process_time()
    result = restore(path, restored)
    restore_s = process_time() - before_s
    checkpoint.close()
    before_s = process_time()
    Checkpoint(path, checkpointed, 0).close()
    return {
        "estimator": estimator,
        "agents": agents,
        "theta": theta,
        "period_s": period_s,
        "rows": result.rows,
        "learning_s": learning_s,
        "noting_to_learning": checkpointing_s / learning_s,
        "writing_us_per_row": 1e6 * writing_s / result.rows,
        "recall_s": restore_s,
        "recall_to_learning": restore_s / learning_s,
        "checkpoint_ms": 1e3 * (process_time() - before_s),
        "same": restored.kept() == checkpointed.kept() == plain.kept(),
    }


def _learn(beliefs: FleetBeliefs, agents: int, theta: int, period_s: int) -> float:
    before_s = process_time()
    for packets, now_ms in _ticks(agents, theta, period_s):
        for packet in packets:
            beliefs.hear(packet, MissionMs(now_ms))
    return process_time() - before_s


def _ticks(agents: int, theta: int, period_s: int) -> Iterator[tuple[list[StatusPacket], int]]:
    """Rounds of packets, until a full write of the checkpoint would be due."""
    noise = random.Random(1)
    for n in range(ROWS // agents):
        now_ms = 1000 * n * period_s
        if now_ms >= PERIOD_MS:
            return
        yield (
            [
                StatusPacket(
                    agent_id,
                    n % 256,
                    State.ACTIVE,
                    0.9 - 0.0005 * n + noise.gauss(0, 0.005),
                    1.0,
                    float(agent_id),
                    2.0,
                    3.0,
                    theta * now_ms,
                )
                for agent_id in range(1, agents + 1)
            ],
            now_ms,
        )


def _scenario(estimator: str, agents: int, theta: int) -> Scenario:
    scenario = load(SCENARIO)
    kind = EstimatorKind(estimator)
    return replace(
        scenario,
        theta=theta,
        fleet=replace(scenario.fleet, count=agents, start=RandomStart(charge=(0.9, 0.9))),
        beliefs=Beliefs(estimator=kind, twin=TWIN if kind is EstimatorKind.TWIN else None),
    )


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(
        "estimator",
        "aMussels",
        "theta",
        "rows",
        "us to write a row",
        "ms a checkpoint",
        "s to recall",
        "of learning",
        "same",
    )
    for row in result["rows"]:
        table.add_row(
            row["estimator"],
            str(row["agents"]),
            str(row["theta"]),
            str(row["rows"]),
            f"{row['writing_us_per_row']:.1f}",
            f"{row['checkpoint_ms']:.0f}",
            f"{row['recall_s']:.2f}",
            f"{row['recall_to_learning']:.2f}",
            "yes" if row["same"] else "NO",
        )
    console.print(table)
