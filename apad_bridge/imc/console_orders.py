"""A console's messages as orders to the supervisor, and the answers to them. Pure: it sends nothing, and waits for nothing.

A plan has one manoeuvre, Goto or StationKeeping, which becomes a go-to or a hold. PlanControl's stop and Abort are the
bench's own. The supervisor judges every order as that of any person (`apad_bridge/supervisor/control_server.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.events.person_orders import Act
from apad_bridge.imc import protocol as imc
from apad_bridge.imc.imc_messages import MISSION_PLAN, plain, plan_information, plan_list
from apad_bridge.imc.protocol import Message
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.supervisor.control_protocol import Answer, Request

MOST_PLANS = 64
_DB, _CONTROL = imc.PlanDB, imc.PlanControl


@dataclass(frozen=True, slots=True)
class ConsoleOrder:
    """An order for the supervisor, and the message that asked for it."""

    request: Request
    asked: Message
    plan_id: str = ""
    """The plan that is executed once the order is accepted; empty for an order that starts none."""
    remark: str = ""
    """Part of the message that is not followed, told with the answer to an accepted order."""

    def answer(self, answer: Answer) -> Message:
        """The answer to the console: to a PlanControl another one, to anything else an entry of the log book."""
        if not isinstance(self.asked, _CONTROL):
            message = imc.LogBookEntry()
            kinds = imc.LogBookEntry.TypeEnum
            message.type = kinds.INFO if answer.accepted else kinds.ERROR
            message.context = "musselbed"
            done = "; ".join(it for it in (answer.message or "done", self._figures_of(answer)) if it)
            message.text = plain(f"{self.request.act}: {done if answer.accepted else f'refused: {done}'}")
            return message
        return _reply(
            self.asked,
            answer.accepted,
            "; ".join(it for it in (answer.message, self._figures_of(answer)) if it),
        )

    def _figures_of(self, answer: Answer) -> str:
        return self.remark if answer.accepted else ""


class Unfit(ValueError):
    """A message that no order can be made of; the text says why."""


class ConsoleOrders:
    """The store of plans, and the making of orders."""

    def __init__(self, frame: LocalFrame, system_name: str) -> None:
        self._frame = frame
        self._system_name = system_name
        self._plans: dict[str, tuple[Message, float, int]] = {}
        """The plan, when it was stored by the wall clock, and by whom."""

    def take(self, message: Message, by: str, now_s: float) -> ConsoleOrder | Message | None:
        """The order that the message means, an answer at once, or None for a message that asks for nothing.

        Unfit for an order that cannot be understood and has no answer of its own.
        """
        match message:
            case imc.Abort():
                return ConsoleOrder(Request(Act.ABORT, by), message)
            case imc.Goto() | imc.StationKeeping():
                return ConsoleOrder(
                    self._of_manoeuvre(message, by), message, message.msg_name, _remark(message)
                )
            case _CONTROL() if message.type == _CONTROL.TypeEnum.REQUEST:
                try:
                    return self._of_plan_control(message, by, now_s)
                except Unfit as unfit:
                    return _reply(message, False, str(unfit))
            case _DB() if message.type == _DB.TypeEnum.REQUEST:
                try:
                    return self._of_store(message, now_s)
                except Unfit as unfit:
                    return _reply(message, False, str(unfit))
            case _:
                return None

    def _of_plan_control(self, message: Message, by: str, now_s: float) -> ConsoleOrder | Message:
        operations = _CONTROL.OperationEnum
        match message.op:
            case operations.STOP:
                return ConsoleOrder(Request(Act.STOP, by), message)
            case operations.START:
                return self._start(message, by, now_s)
            case operations.LOAD:
                self._of_manoeuvre(_only_manoeuvre(self._plan_of(message)), by)
                return _reply(message, True, "")
            case operations.GET:
                reply = _reply(message, True, "")
                reply.arg = self._stored(message.plan_id)
                return reply
            case _:
                raise Unfit("an unknown operation")

    def _start(self, message: Message, by: str, now_s: float) -> ConsoleOrder:
        if message.arg is None and message.plan_id == MISSION_PLAN:
            return ConsoleOrder(Request(Act.GIVE_BACK, by), message)
        if isinstance(message.arg, imc.PlanSpecification):
            self._store(message.arg, message.src, now_s)
        manoeuvre = message.arg
        if not isinstance(manoeuvre, imc.Goto | imc.StationKeeping):
            manoeuvre = _only_manoeuvre(self._plan_of(message))
        plan_id = message.plan_id or getattr(message.arg, "plan_id", "")
        return ConsoleOrder(self._of_manoeuvre(manoeuvre, by), message, plan_id, _remark(manoeuvre))

    def _plan_of(self, message: Message) -> Message:
        """The plan that comes with the message, or else the stored one that it names."""
        if isinstance(message.arg, imc.PlanSpecification):
            return message.arg
        if message.arg is not None:
            raise Unfit(
                f"{message.arg.msg_name} is no plan, and no manoeuvre of the aPad's: Goto, StationKeeping"
            )
        return self._stored(message.plan_id)

    def _of_manoeuvre(self, manoeuvre: Message, by: str) -> Request:
        if manoeuvre.z_units != imc.ZUnits.NONE and manoeuvre.z != 0:
            raise Unfit("the aPad stays at the surface: a depth of 0 is asked for")
        goal_m = self._local_m(manoeuvre.lat, manoeuvre.lon)
        if isinstance(manoeuvre, imc.StationKeeping):
            return Request(Act.HOLD, by, goal_m=goal_m)
        if manoeuvre.speed_units != imc.SpeedUnits.METERS_PS:
            return Request(Act.GO_TO, by, goal_m=goal_m)
        if not math.isfinite(manoeuvre.speed):
            raise Unfit("a speed that is no number")
        return Request(Act.GO_TO, by, goal_m=goal_m, speed_m_s=manoeuvre.speed)

    def _local_m(self, latitude_rad: float, longitude_rad: float) -> tuple[float, float]:
        if not (
            abs(latitude_rad) <= math.pi / 2 and abs(longitude_rad) <= math.pi
        ):  # False for no number, too
            raise Unfit("no latitude and longitude in radians")
        return self._frame.to_local(math.degrees(latitude_rad), math.degrees(longitude_rad))

    def _of_store(self, message: Message, now_s: float) -> Message:
        operations = _DB.OperationEnum
        reply = _reply(message, True, "")
        match message.op:
            case operations.SET:
                if not isinstance(message.arg, imc.PlanSpecification):
                    raise Unfit("there is no plan to store")
                self._store(message.arg, message.src, now_s)
            case operations.DEL:
                self._stored(message.plan_id)
                del self._plans[message.plan_id]
            case operations.GET:
                reply.arg = self._stored(message.plan_id)
            case operations.GET_INFO:
                self._stored(message.plan_id)
                reply.arg = plan_information(*self._plans[message.plan_id])
            case operations.CLEAR:
                self._plans.clear()
            case operations.GET_STATE | operations.GET_DSTATE:
                entries = [plan_information(*it) for _, it in sorted(self._plans.items())]
                reply.arg = plan_list(entries, self._system_name)
            case operations.BOOT:
                pass
            case _:
                raise Unfit("an unknown operation")
        return reply

    def _store(self, plan: Message, by: int, now_s: float) -> None:
        if not plan.plan_id or plan.plan_id == MISSION_PLAN:
            raise Unfit(f"a plan needs a name, and another one than `{MISSION_PLAN}`")
        if plan.plan_id not in self._plans and len(self._plans) >= MOST_PLANS:
            raise Unfit(f"no more than {MOST_PLANS} plans are kept: delete one")
        self._plans[plan.plan_id] = (plan.clone(), now_s, by)

    def _stored(self, plan_id: str) -> Message:
        if plan_id not in self._plans:
            raise Unfit(f"no plan `{plan_id}` is here")
        return self._plans[plan_id][0]


def _remark(manoeuvre: Message) -> str:
    """Neptus sends a surface vehicle without a speed of its own to a place at 1000 RPM."""
    if isinstance(manoeuvre, imc.StationKeeping) or manoeuvre.speed_units == imc.SpeedUnits.METERS_PS:
        return ""
    unit = "RPM" if manoeuvre.speed_units == imc.SpeedUnits.RPM else "percent"
    return f"at the scenario's speed, for one in {unit} means nothing to this aPad"


def _only_manoeuvre(plan: Message) -> Message:
    manoeuvres = [it.data for it in plan.maneuvers]
    if len(manoeuvres) != 1 or not isinstance(manoeuvres[0], imc.Goto | imc.StationKeeping):
        raise Unfit("a plan of the aPad's has one manoeuvre, Goto or StationKeeping")
    return manoeuvres[0]


def _reply(asked: Message, accepted: bool, text: str) -> Message:
    """The answer of a PlanControl or a PlanDB, with its operation, its plan and the number of the request."""
    reply = type(asked)()
    reply.type = asked.TypeEnum.SUCCESS if accepted else asked.TypeEnum.FAILURE
    reply.op, reply.request_id, reply.plan_id = asked.op, asked.request_id, asked.plan_id
    reply.info = plain(text)
    return reply
