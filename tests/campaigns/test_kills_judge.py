"""The judge of kills finds nothing in a healthy run's records, and each fault that is put into them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from kills.judge import Ending, judge
from kills.mixes import ROWS, drawn
from kills.records import Records, records_of

from apad_bridge.commands.main import main

ENDED = Ending(0, "", clock="virtual")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A healthy run in virtual time, with dockings, services and a bag."""
    folder = tmp_path_factory.mktemp("kills")
    data = drawn("pool", "a", "healthy").scenario | {"faults": None, "duration_s": 150}
    data["fleet"] |= {"hosting": "one_process", "start": {"charge": [0.5, 0.7]}}
    (folder / "scenario.yaml").write_text(yaml.safe_dump(data))
    words = ["run", str(folder / "scenario.yaml"), "--time", "asap", "--out", str(folder / "run"), "--json"]
    assert main(words) == 0
    return folder / "run"


@pytest.fixture
def records(run: Path) -> Records:
    return records_of(run)


def first(found: Records, kind: str, **fields: Any) -> dict[str, Any]:
    return next(it for it in found.of_kind(kind) if fields.items() <= it.items())


def lose(kind: str, **fields: Any) -> Callable[[Records], None]:
    return lambda found: found.lines.remove(first(found, kind, **fields))


def double(kind: str, **fields: Any) -> Callable[[Records], None]:
    def doctor(found: Records) -> None:
        line = first(found, kind, **fields)
        found.lines.insert(found.lines.index(line), line)

    return doctor


def without_bags(doctor: Callable[[Records], None]) -> Callable[[Records], None]:
    """The journal alone must show it, too."""

    def both(found: Records) -> None:
        doctor(found)
        found.bags, found.in_bags, found.charges = 0, [], {}

    return both


def an_id_twice(found: Records) -> None:
    agents = found.lines[0]["agents"]
    agents[1]["id"] = agents[0]["id"]


def an_order_falls(found: Records) -> None:
    found.of_kind("mission")[-1]["snapshot"]["primitive_id"] = 1


def charge_told_by_packets(found: Records) -> None:
    """From the middle of the run on an aMussel tells more than it can have, and drains as it should."""
    beliefs = [it for it in found.of_kind("belief") if it["id"] == 1]
    for it in beliefs[len(beliefs) // 2 :]:
        it["charge"] += 0.1


def charge_in_the_truths(found: Records) -> None:
    charges = found.charges[2]
    middle = len(charges) // 2
    found.charges[2] = [replace(it, held=it.held + 0.001 * (n > middle)) for n, it in enumerate(charges)]


def charge_is_lost(found: Records) -> None:
    charges = found.charges[2]
    middle = len(charges) // 2
    found.charges[2] = [replace(it, held=it.held - 0.001 * (n > middle)) for n, it in enumerate(charges)]


def a_leg_never_flown(found: Records) -> None:
    """The aPad stays where it was when the longest leg was ordered, and says that it has come."""
    from_ms = max(found.of_kind("leg"), key=lambda it: it["metres"])["t"]
    go_tos = [it for it in found.of_kind("primitive") if it["name"] == "go to point"]
    until_ms = next(it["t"] for it in go_tos if it["t"] > from_ms and it["phase"] == "succeeded")
    stays = [it for it in found.places if it[0] <= from_ms][-1]
    found.places = [(it[0], *stays[1:]) if from_ms < it[0] <= until_ms else it for it in found.places]


def a_leg_of_another_length(found: Records) -> None:
    first(found, "leg")["metres"] += 5


def summary(**changes: Any) -> Callable[[Records], None]:
    def doctor(found: Records) -> None:
        assert found.summary is not None
        found.summary |= changes

    return doctor


def a_torn_line(found: Records) -> None:
    found.unread.append("journal.jsonl, line 7: b'{'")


def no_end(found: Records) -> None:
    found.lines.remove(first(found, "end"))
    found.summary = None


DOCTORED: dict[str, tuple[Callable[[Records], None], str]] = {
    "a lost line": (lose("primitive", name="dock", phase="started"), "in a bag, and not in the journal"),
    "a lost service": (without_bags(lose("released", full=True)), "services"),
    "a lost dock": (without_bags(lose("dock", closed=True)), "which it did not hold"),
    "a lost leg": (without_bags(lose("leg")), "planned way"),
    "a doubled dock": (double("dock", closed=True), "twice in the journal"),
    "a doubled leg": (without_bags(double("leg")), "twice in the journal"),
    "a doubled id": (an_id_twice, "the fleet has an id twice"),
    "an order that falls": (an_order_falls, "the number of an order falls"),
    "an unknown aMussel": (lambda found: first(found, "belief").update(id=99), "not of the fleet"),
    "time that falls": (lambda found: found.lines[40].update(t=0), "time falls"),
    "a supervisor that is not told": (lambda found: setattr(found, "epoch", 2), "2 supervisors began"),
    "energy from nowhere in packets": (charge_told_by_packets, "energy from nowhere: aMussel 1 by packets"),
    "energy from nowhere in truths": (charge_in_the_truths, "energy from nowhere: aMussel 2 by the bag"),
    "energy that is lost": (charge_is_lost, "energy is lost: aMussel 2 by the bag"),
    "a leg never flown": (a_leg_never_flown, "a leg was never flown"),
    "a leg of another length": (a_leg_of_another_length, "begins"),
    "a step of a plan that is forgotten": (
        lambda found: first(found, "plan")["steps"].append({"agent": 8, "dock": 3}),
        "was forgotten",
    ),
    "a way that was not driven": (summary(cost_m=999.0), "the summary's cost"),
    "an end of another time": (summary(mission_s=1.0), "the journal ends with"),
    "a torn line": (a_torn_line, "cannot be read"),
    "no end": (no_end, "nobody said why"),
}


def test_a_healthy_run_has_no_failure(records: Records) -> None:
    assert len(records.of_kind("leg")) > 4 and records.summary is not None and records.summary["services"]
    assert judge(records, ENDED) == []


@pytest.mark.parametrize("name", DOCTORED)
def test_each_fault_in_the_records_is_a_failure(records: Records, name: str) -> None:
    doctor, why = DOCTORED[name]
    doctor(records)
    assert any(why in it for it in judge(records, ENDED)), judge(records, ENDED)


def test_a_second_without_a_line_is_a_failure_where_time_waits_for_a_supervisor(records: Records) -> None:
    assert [it for it in judge(records, replace(ENDED, clock="own")) if "seconds of mission time" in it] == []
    records.lines = [it for it in records.lines if not 50_000 < it["t"] <= 53_000]
    found = judge(records, replace(ENDED, clock="own"))
    assert "3 seconds of mission time have no line, the first 51 s" in found


def test_a_run_without_an_end_may_say_why_or_be_cut_off_by_a_crash(records: Records) -> None:
    no_end(records)
    records.in_bags = [it for it in records.in_bags if it["kind"] != "end"]
    assert judge(records, replace(ENDED, code=3, said="the master is gone")) == []
    assert judge(records, Ending(None, "", is_over=False, clock="virtual")) == []


def test_the_bag_may_show_a_life_until_its_end_becomes_known(records: Records) -> None:
    charges = records.charges[2]
    at = len(charges) // 2
    records.charges[2] = [
        replace(it, held=it.held - 0.01 * (at <= n < at + 3)) for n, it in enumerate(charges)
    ]
    assert len(judge(records, ENDED)) == 2
    told_ms, died = charges[at + 3].agent_ms // 600, {"kind": "died", "id": 2, "cause": "BROWN_OUT"}
    after = next(n for n, it in enumerate(records.lines) if it["t"] > told_ms)
    records.lines.insert(
        after, died | {"t": told_ms, "agent_ms": charges[at].agent_ms, "reason": "killed", "gave_up": None}
    )
    assert [it for it in judge(records, ENDED) if "energy" in it] == []


def test_a_line_that_is_no_json_is_told_by_its_number(run: Path, tmp_path: Path) -> None:
    for name in ("scenario.yaml", "run.json"):
        (tmp_path / name).write_bytes((run / name).read_bytes())
    (tmp_path / "journal.jsonl").write_bytes((run / "journal.jsonl").read_bytes() + b'{"t":1,"ki\n')
    count = len((run / "journal.jsonl").read_bytes().splitlines())
    (told,) = records_of(tmp_path).unread
    assert told.startswith(f"journal.jsonl, line {count + 1}: ")


@pytest.mark.parametrize("name", ROWS)
def test_a_seed_draws_the_same_mix_and_another_one_another(name: str) -> None:
    mixes = [drawn(name, "a", f"seed {it}") for it in (1, 1, 2, *range(3, 20))]
    assert mixes[0] == mixes[1] != mixes[2]
    for it in mixes:
        assert [act.at_s for act in it.acts] == sorted(act.at_s for act in it.acts)
        assert (it.crash_s is not None) or not ROWS[name].resumes
