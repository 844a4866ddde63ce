"""A console's messages, packed by an independent codec, as orders; and the answers to them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import imcpy
import pytest
from hypothesis import given
from hypothesis import strategies as st
from imc_codec import Codec, inner, name_of

from apad_bridge.events.person_orders import Act
from apad_bridge.imc.console_orders import MOST_PLANS, ConsoleOrder, ConsoleOrders, Unfit
from apad_bridge.imc.imc_messages import stamped
from apad_bridge.imc.systems import Systems
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.supervisor.control_protocol import Answer

FRAME = LocalFrame(43.9330937, 15.4443468)
NEPTUS, APAD = 0x4001, 0x2A01
START, STOP, LOAD, GET = range(4)
SET, DEL, GET_PLAN, GET_INFO, CLEAR, GET_STATE = range(6)
SUCCESS, FAILURE = 1, 2


def radians_at(north_m: float, east_m: float) -> dict[str, float]:
    latitude, longitude = FRAME.to_geographic(north_m, east_m)
    return {"lat": math.radians(latitude), "lon": math.radians(longitude)}


class Desk:
    """Orders of one console, over the wire's bytes both ways."""

    def __init__(self, codec: Codec) -> None:
        self.codec = codec
        self.orders = ConsoleOrders(FRAME, "apad1")

    def take(self, message: Any) -> ConsoleOrder | Any:
        packet = self.codec.pack(message, NEPTUS, APAD)
        taken = self.orders.take(imcpy.Packet.deserialize(packet), "IMC 0x4001", 1e9)
        return taken if taken is None or isinstance(taken, ConsoleOrder) else self.read(taken)

    def read(self, reply: Any) -> Any:
        return self.codec.read(imcpy.Packet.serialize(stamped(reply, Systems().apad("apad1"), 1e9, NEPTUS)))

    def plan(self, *manoeuvres: Any, name: str = "go") -> Any:
        make = self.codec.make
        listed = [make("PlanManeuver", maneuver_id=str(n), data=it) for n, it in enumerate(manoeuvres)]
        return make("PlanSpecification", plan_id=name, start_man_id="0", maneuvers=listed)

    def control(self, op: int, arg: Any = None, plan_id: str = "go") -> ConsoleOrder | Any:
        return self.take(self.codec.make("PlanControl", op=op, arg=arg, plan_id=plan_id, request_id=77))

    def store(self, op: int, arg: Any = None, plan_id: str = "go") -> Any:
        return self.take(self.codec.make("PlanDB", op=op, arg=arg, plan_id=plan_id, request_id=78))


@pytest.fixture
def desk(codec: Codec) -> Desk:
    return Desk(codec)


@given(
    north_m=st.floats(-5000, 5000),
    east_m=st.floats(-5000, 5000),
    speed_m_s=st.floats(0.0, 5.0, width=32),
    is_in_a_plan=st.booleans(),
)
def test_a_goto_is_a_go_to_there_to_a_millimetre(
    codec: Codec, north_m: float, east_m: float, speed_m_s: float, is_in_a_plan: bool
) -> None:
    desk = Desk(codec)
    there = goto(codec, speed=speed_m_s, **radians_at(north_m, east_m))
    taken = desk.control(START, desk.plan(there)) if is_in_a_plan else desk.take(there)
    asked = taken.request
    assert (asked.act, asked.by) == (Act.GO_TO, "IMC 0x4001")
    assert asked.goal_m == pytest.approx((north_m, east_m), abs=1e-3)
    assert asked.speed_m_s == pytest.approx(speed_m_s)


def test_a_plan_that_was_stored_is_started_by_its_name(desk: Desk) -> None:
    station = desk.codec.make("StationKeeping", radius=5.0, speed=0.5, **radians_at(3.0, 4.0))
    assert desk.control(START).type == FAILURE
    stored = desk.store(SET, desk.plan(station))
    assert (name_of(stored), stored.type, stored.op, stored.request_id) == ("PlanDB", SUCCESS, SET, 78)
    taken = desk.control(START)
    goal_m = pytest.approx((3.0, 4.0), abs=1e-3)
    assert (taken.request.act, taken.request.goal_m, taken.plan_id) == (Act.HOLD, goal_m, "go")
    answered = desk.read(taken.answer(Answer(False, "refused: outside the fence")))
    told = answered.type, answered.op, answered.request_id, answered.plan_id, answered.info
    assert told == (FAILURE, START, 77, "go", "refused: outside the fence")

    (listed,) = inner(inner(desk.store(GET_STATE), "arg"), "plans_info")
    got = inner(desk.store(GET_PLAN), "arg")
    assert (listed.plan_id, got.plan_id, len(listed.md5)) == ("go", "go", 16)
    assert name_of(inner(inner(got, "maneuvers")[0], "data")) == "StationKeeping"
    assert inner(desk.store(GET_INFO), "arg").md5 == listed.md5
    assert [desk.store(DEL).type, desk.store(DEL).type] == [SUCCESS, FAILURE]
    assert inner(desk.store(GET_STATE), "arg").plan_count == 0


@pytest.mark.parametrize(
    ("kind", "fields", "act"),
    [
        ("PlanControl", {"op": STOP}, Act.STOP),
        ("Abort", {}, Act.ABORT),
        ("PlanControl", {"op": START, "plan_id": "mission"}, Act.GIVE_BACK),
        ("Heartbeat", {}, None),
        ("PlanControl", {"type": SUCCESS, "op": STOP}, None),  # an answer, and no request
    ],
)
def test_stop_abort_and_the_mission_itself(
    desk: Desk, kind: str, fields: dict[str, Any], act: Act | None
) -> None:
    taken = desk.take(desk.codec.make(kind, **fields))
    assert (None if taken is None else taken.request.act) is act


def test_why_an_abort_was_refused_is_told(desk: Desk) -> None:
    over = Answer(False, "the mission is over: mission time")
    told = desk.read(desk.take(desk.codec.make("Abort")).answer(over))
    assert name_of(told) == "LogBookEntry" and "the mission is over" in told.text


def goto(codec: Codec, **fields: Any) -> Any:
    return codec.make("Goto", **{"speed": 0.5, **radians_at(1.0, 1.0), **fields})


@pytest.mark.parametrize(
    "fields", [{"z": 2.0, "z_units": 1}, {"speed": math.nan}], ids=["under water", "no number"]
)
def test_what_the_apad_cannot_do_is_refused_with_the_reason(desk: Desk, fields: dict[str, float]) -> None:
    why = "no number" if "speed" in fields else "stays at the surface"
    refused = desk.control(START, desk.plan(goto(desk.codec, **fields)))
    assert refused.type == FAILURE and why in refused.info
    with pytest.raises(Unfit, match=why):
        desk.take(goto(desk.codec, **fields))


@pytest.mark.parametrize(
    ("manoeuvres", "why"),
    [
        ([], "one manoeuvre"),
        (["Goto", "Goto"], "one manoeuvre"),
        (["Heartbeat"], "one manoeuvre"),
        (None, "is no plan"),
    ],
)
def test_a_plan_of_no_or_several_manoeuvres_or_of_another_kind_is_refused(
    desk: Desk, manoeuvres: list[str] | None, why: str
) -> None:
    made = [goto(desk.codec) if it == "Goto" else desk.codec.make(it) for it in manoeuvres or ()]
    plan = desk.codec.make("Heartbeat") if manoeuvres is None else desk.plan(*made)
    assert {why in desk.control(op, plan).info for op in (START, LOAD)} == {True}


@pytest.mark.parametrize(("units", "named"), [(1, "RPM"), (2, "percent")])
@pytest.mark.parametrize("is_in_a_plan", [True, False])
def test_a_speed_of_another_unit_is_the_scenarios_and_the_answer_says_so(
    desk: Desk, units: int, named: str, is_in_a_plan: bool
) -> None:
    """Neptus sends a surface vehicle without a speed of its own to a place at 1000 RPM."""
    there = goto(desk.codec, speed=1000.0, speed_units=units, **radians_at(3.0, 4.0))
    order = desk.control(START, desk.plan(there)) if is_in_a_plan else desk.take(there)
    assert (order.request.act, order.request.speed_m_s) == (Act.GO_TO, None)
    assert order.request.goal_m == pytest.approx((3.0, 4.0), abs=1e-3)
    taken, refused = (desk.read(order.answer(it)) for it in (Answer(True, ""), Answer(False, "fence")))
    text = taken.info if is_in_a_plan else taken.text
    assert "at the scenario's speed" in text and named in text
    assert "scenario's speed" not in getattr(refused, "info", "")
    keeping = desk.codec.make("StationKeeping", speed=50.0, speed_units=units, **radians_at(1.0, 1.0))
    assert desk.control(START, desk.plan(keeping)).request.act is Act.HOLD


@pytest.mark.parametrize("place", [(43.9, 15.4), (math.nan, 0.2), (0.7, math.inf)])
def test_degrees_and_what_is_no_number_are_refused(desk: Desk, place: tuple[float, float]) -> None:
    goto = imcpy.Goto()  # the independent codec packs no such place
    goto.lat, goto.lon = place
    goto.speed = 0.5
    with pytest.raises(Unfit, match="radians"):
        desk.orders.take(goto, "IMC 0x4001", 1e9)


def test_the_store_of_plans_is_bounded(desk: Desk) -> None:
    """A plan takes the place of the old one of its name; `mission` is the name of the mission itself."""
    stores = [(SET, str(n)) for n in range(MOST_PLANS)]
    stores += [(SET, "one more"), (SET, "0"), (SET, "mission"), (CLEAR, ""), (SET, "one more")]
    plans = [desk.plan(goto(desk.codec), name=name) if op == SET else None for op, name in stores]
    answered = [desk.store(op, plan).type for (op, _), plan in zip(stores, plans, strict=True)]
    assert answered == [*[SUCCESS] * MOST_PLANS, FAILURE, SUCCESS, FAILURE, SUCCESS, SUCCESS]


@pytest.mark.parametrize(
    ("name", "imc_id"),
    [("apad1", 0x2A01), ("apad12", 0x2A0C), ("boat", 0x2A01), ("/lab/apad2", 0x2A02), (7, 0x9A07)],
)
def test_ids_follow_the_addressing_scheme(name: str | int, imc_id: int) -> None:
    system = Systems().apad(name) if isinstance(name, str) else Systems().amussel(name)
    assert system.imc_id == imc_id


def test_ids_keep_to_their_ranges() -> None:
    """Of IMC_Addresses.xml's list of ids: wg-sv3-127, ntnu-nest-01 and -02 have the first of the ranges."""
    amussels = {Systems().amussel(n).imc_id for n in (*range(51), 1535, 1536, 0xFFFF)}
    apads = {Systems().apad(f"apad{n}").imc_id for n in (1, 511, 512, 99_999)}
    assert amussels <= {*range(0x9A00, 0xA000)} - {0x9001, 0x9002}
    assert apads <= {*range(0x2A00, 0x2C00)} - {0x2801}


def test_the_shipped_definition_is_that_of_the_aPad_which_the_gateway_shows() -> None:
    root = ElementTree.parse(Path(__file__).parents[3] / "launch_scripts/neptus/90-apad1.nvcl").getroot()
    system = Systems().apad("apad1")
    assert root.findtext("properties/id") == system.name and root.findtext("properties/type") == "ASV"
    imc = root.find("communication-means/comm-mean/protocols-args/imc")
    high, low = (imc.findtext("imc-id") or "").split(":")
    assert int(high + low, 16) == system.imc_id
    assert int(imc.findtext("port") or 0) == Systems().port("apad1")
    manoeuvres = {it[0].tag: it[0] for it in root.findall("feasibleManeuvers/maneuver")}
    assert manoeuvres.keys() == {"Goto", "StationKeeping"}
    speeds = [next(it for it in own if it.tag in ("velocity", "speed")) for own in manoeuvres.values()]
    assert [(it.get("unit"), float(it.text or 0)) for it in speeds] == [("m/s", 0.5)] * 2
