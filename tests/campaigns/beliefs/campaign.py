"""Beliefs of aMussels in times without packets: error, coverage and consistency of the twin, its peers and an oracle."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.progress import Progress

from beliefs import cost, places, study
from beliefs.score import score
from beliefs.truth import AGENTS, DAYS
from benchmarks.rows import told

PEERS = ("kalman", "imm")


SHORT_AGENTS, SHORT_PLACES, SHORT_HEARD = 1, 10, (1.0, 0.1)
"""The short tier: one seed, one aMussel whose charge is believed, ten whose place is, and two shares of packets."""
TICKS, SHORT_TICKS = (120, 1000), (120,)
"""Fleets whose tick is timed."""


def measure(
    agents: int = AGENTS, seeds: tuple[int, ...] = study.REPORTED, short: bool = False
) -> dict[str, Any]:
    """`rows` by knowledge, share of packets received and filter, on the same lives; also `place`, `cost` and `tick_ms`.

    Peers know neither schedule nor dockings: they are the same in both blocks. hold_last claims to be certain, so it has
    no coverage. `mode_delay_packets` is a median: the packets after the first one received since an unscheduled switch
    until the mode was right.
    """
    shares: tuple[float, ...] = study.HEARD
    placed_agents = places.AGENTS
    if short:
        agents, seeds = SHORT_AGENTS, study.REPORTED[:1]
        shares, placed_agents = SHORT_HEARD, SHORT_PLACES
    cells = [
        (name, knows, heard) for knows in (True, False) for heard in shares for name in (*study.OURS, *PEERS)
    ]
    jobs = [
        (name, seed, agents, knows, heard)
        for name, knows, heard in cells
        if name in study.OURS
        for seed in seeds
    ]
    # Measure costs first, while nothing else runs.
    costs = cost.event_costs()
    ticks = [cost.tick_ms(count, theta) for count in (SHORT_TICKS if short else TICKS) for theta in (1, 30)]
    found: dict[tuple[str, bool, float], list[tuple[npt.NDArray[Any], list[int]]]] = {}
    with (
        Progress(console=Console(stderr=True), transient=True) as progress,
        ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool,
    ):
        placed = [
            pool.submit(places.coverage, theta, currents, agents=placed_agents)
            for theta in (1, 30)
            for currents in (False, True)
        ]
        task = progress.add_task("filtering", total=len(jobs))
        for job, one in zip(jobs, pool.map(_rows, jobs), strict=True):
            found.setdefault((job[0], job[3], job[4]), []).append(one)
            progress.advance(task)
        place = [it.result() for it in placed]
    rows = []
    peers = {}

    def keep(row: dict[str, Any]) -> None:
        rows.append(told(row))

    for name, knows, heard in cells:
        head = {"knows": "schedule" if knows else "dockings", "heard": heard, "filter": name}
        if name in PEERS:
            if (name, heard) not in peers:
                peer, checked = study.peer_rows(name, seeds, agents, heard)
                peers[name, heard] = {**score(peer), **checked}
            keep({**head, **peers[name, heard]})
            continue
        parts = found[name, knows, heard]
        delays = [delay for _, some in parts for delay in some]
        scored = score(np.concatenate([part for part, _ in parts]), certain=name == "hold_last")
        keep({**head, **scored, "mode_delay_packets": float(np.median(delays)) if delays else None})
    return {
        "agents": agents,
        "days": DAYS,
        "seeds": list(seeds),
        "tuned_on": study.TUNED_ON,
        "rows": rows,
        "place": place,
        **costs,
        "tick_ms": ticks,
    }


def _rows(job: tuple[str, int, int, bool, float]) -> tuple[npt.NDArray[Any], list[int]]:
    name, seed, agents, knows, heard = job
    return study.rows_of(name, seed, agents, knows, heard)
