"""The aMussels' starting places and charges: drawn at random, or read from a file or a former run.

Draws come from a keyed hash of (seed, agent id, counter), so an agent's start depends neither on the number of other
agents nor on the order of the draws.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from hashlib import blake2b
from pathlib import Path
from struct import Struct

from agents.fleet_config import deviations_of
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.area.polygon import Point, bounding_box, contains
from apad_bridge.scenario.errors import ScenarioError, in_ranges
from apad_bridge.scenario.schema import Area, Origin, RandomStart, Scenario
from apad_bridge.scenario.starts_table import Start, read_table, table_of
from apad_bridge.scenario.text.text_file import write_atomically

_KEY = Struct("<QQQ")
_DIGEST = Struct("<QQ")
_UNIT = 2.0**-53
_CHARGE_DRAW = 0  # draws of a place count from 1


def starts_of(scenario: Scenario) -> tuple[Start, ...]:
    """Returns the fleet's starts in the order of their ids: the whole fleet's, or only those of its `share`.

    Raises ScenarioError with a line for each mistake in the file that they come from.
    """
    fleet = scenario.fleet

    def secondary_of(agent_id: int) -> float:
        """The charge of a secondary battery that no start states: a battery loses charge in store, and gains none."""
        below_full = fleet.spread.secondary_start * abs(deviations_of(scenario.seed, agent_id, b"secondary"))
        return 1.0 - below_full

    if isinstance(fleet.start, RandomStart):
        return tuple(
            replace(
                random_start(scenario.seed, agent_id, scenario.area, fleet.start),
                secondary=secondary_of(agent_id),
            )
            for agent_id in fleet.ids
        )
    return read_starts(Path(fleet.start), scenario.area, fleet.ids, secondary_of)


def random_start(seed: int, agent_id: int, area: Area, start: RandomStart) -> Start:
    """Draws a place uniform in the polygon, by rejection from its bounding box, and a charge uniform in `start.charge`."""
    (south, west), (north, east) = bounding_box(area.polygon_m)
    draw = _CHARGE_DRAW + 1
    place = _point_in(seed, agent_id, draw, (south, west), (north, east))
    while not contains(area.polygon_m, place):
        draw += 1
        place = _point_in(seed, agent_id, draw, (south, west), (north, east))
    low, high = start.charge
    fraction, _ = _uniform_pair(seed, agent_id, _CHARGE_DRAW)
    return Start(agent_id, place[0], place[1], min(high, low + fraction * (high - low)))


def read_starts(
    path: Path, area: Area, ids: Collection[int], secondary_of: Callable[[int], float] = lambda _: 1.0
) -> tuple[Start, ...]:
    """Reads the starts of `ids`, rising, from a CSV or a former run's directory; other rows do not count.

    `secondary_of` returns the charge of a secondary battery, by id, where the file has no such column.

    In a directory, it reads `ends.csv` if the run got so far, else `starts.csv`. Places in a CSV must lie in or near the
    area's bounding box; places of a former run need not, because its agents may have drifted. Raises ScenarioError.
    """
    former_run = path.is_dir()
    table = table_of(path)
    rows = read_table(table, LocalFrame.about(area.origin), secondary_of)
    if not former_run:
        _refuse_far_rows(table, rows, area)
    wanted = set(ids)
    chosen = sorted((it for it in rows.values() if it.agent_id in wanted), key=lambda it: it.agent_id)
    if missing := wanted - {it.agent_id for it in chosen}:
        there = in_ranges(it.agent_id for it in rows.values()) or "none"
        raise ScenarioError(
            [
                f"{table}: no row for {in_ranges(missing)}; its ids are {there}: "
                "leave fleet.count and fleet.first_id out to take the file's ids, or add rows, or let starts be drawn: "
                "start: {charge: [0.7, 1.0]}"
            ]
        )
    return tuple(chosen)


def save_starts(path: Path, starts: Iterable[Start], origin: Origin) -> None:
    """Writes a CSV from which `read_starts` returns the same starts: exact north and east, lat and lon to 0.1 mm.

    Further columns follow. The file appears whole or not at all.
    """
    frame, starts = LocalFrame.about(origin), tuple(starts)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    further = further_columns(starts)
    writer.writerow(["id", "lat", "lon", "north", "east", "battery", "secondary", *further])
    for start in starts:
        latitude_deg, longitude_deg = frame.to_geographic(start.north_m, start.east_m)
        exact = [repr(it) for it in (start.north_m, start.east_m, start.primary, start.secondary)]
        texts = [dict(start.further).get(column, "") for column in further]
        writer.writerow([start.agent_id, f"{latitude_deg:.9f}", f"{longitude_deg:.9f}", *exact, *texts])
    write_atomically(path, text.getvalue())


def further_columns(starts: Iterable[Start]) -> list[str]:
    """The names of the further columns of the starts, each once, in their order."""
    return list(dict.fromkeys(column for start in starts for column, _ in start.further))


def _refuse_far_rows(table: Path, rows: Mapping[int, Start], area: Area) -> None:
    """Refuses places outside the bounding box grown by a tenth on each side: lat and lon swapped, or another origin."""
    (south, west), (north, east) = bounding_box(area.polygon_m)
    margin_north, margin_east = (north - south) / 10, (east - west) / 10
    lines = [
        f"{table}:{line}: aMussel {it.agent_id} lies outside of the area: "
        f"north {it.north_m:.1f} m, east {it.east_m:.1f} m"
        for line, it in rows.items()
        if not (
            south - margin_north <= it.north_m <= north + margin_north
            and west - margin_east <= it.east_m <= east + margin_east
        )
    ]
    if lines:
        raise ScenarioError(lines)


def _point_in(seed: int, agent_id: int, n: int, low: Point, high: Point) -> Point:
    fraction_north, fraction_east = _uniform_pair(seed, agent_id, n)
    return (low[0] + fraction_north * (high[0] - low[0]), low[1] + fraction_east * (high[1] - low[1]))


def _uniform_pair(seed: int, agent_id: int, n: int) -> tuple[float, float]:
    """Draws two independent numbers, uniform in [0, 1) in steps of 2^-53."""
    digest = blake2b(_KEY.pack(seed, agent_id, n), digest_size=16, person=b"musselbed start").digest()
    first, second = _DIGEST.unpack(digest)
    return (first >> 11) * _UNIT, (second >> 11) * _UNIT
