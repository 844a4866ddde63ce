"""The part of the script API that only reads: time, beliefs, docks and forecasts.

A forecast says how probable something is at a later mission time, or from when on it is sure. The estimator computes it
as if nothing more were received and nothing more done until then.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Annotated, Any, TypeVar, cast

import numpy as np
from annotated_types import Len
from pydantic import (
    ConfigDict,
    Strict,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    validate_call,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet_beliefs import Estimator
from apad_bridge.beliefs.questions import (
    Question,
    candidate_below,
    full_above,
    lost,
    probability_at,
    sure_at_ms,
)
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.policy.pool import ChargingPool
from apad_bridge.mission.script_values import Agent, Location, Refused, dock_of
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.blocks.mission_options import Mission
from apad_bridge.scenario.errors import in_ranges
from apad_bridge.scripting.rendezvous import Do, Rendezvous, Wait

# Checks the arguments of a script's API calls before anything is done, by their annotations.
#
# A wrong argument gives one line that names the argument, in place of an error from deep inside the API.
C = TypeVar("C", bound=type)


def _point(value: Any, check: ValidatorFunctionWrapHandler) -> Any:
    try:
        return check(value)
    except ValidationError:
        raise PydanticCustomError("point", "must be [latitude, longitude] in degrees") from None


Point = Annotated[Sequence[float], Len(2, 2), WrapValidator(_point)]
"""[latitude, longitude] in degrees, or a `Location`."""
Flag = Annotated[bool, Strict(False)]
"""True or False, or 1 or 0 for them."""
_OF_APAD = ": battery(id_self), get_location(id_self), docks() and cost() tell of the aPad"
_STRICT = ConfigDict(strict=True, arbitrary_types_allowed=True)


def checks_arguments(cls: C) -> C:
    """Decorates a class: its public methods raise Refused for arguments that their annotations do not allow."""
    for name, method in list(vars(cls).items()):
        if inspect.isfunction(method) and not name.startswith("_"):
            setattr(cls, name, _checked(method))
    return cls


def _checked(method: Callable[..., Any]) -> Callable[..., Any]:
    checked: list[Callable[..., Any]] = []
    names = list(inspect.signature(method).parameters)

    # Validated apart from the call, so that an error of pydantic's from inside the method is not taken for the caller's.
    @wraps(method)
    def arguments(*args: Any, **kwargs: Any) -> Any:
        return args, kwargs

    @wraps(method)
    def call(*args: Any, **kwargs: Any) -> Any:
        if not checked:  # Made at the first call, when every module that an annotation names is imported.
            checked.append(validate_call(config=_STRICT)(arguments))
        try:
            args, kwargs = checked[0](*map(_plain, args), **{name: _plain(it) for name, it in kwargs.items()})
        except ValidationError as error:
            own = _OF_APAD if vars(args[0]).get("id_self") in (*args[1:], *kwargs.values()) else ""
            raise Refused(f"{method.__name__}: {_line(error.errors(), names)}{own}") from None
        return method(*args, **kwargs)

    return call


def _plain(value: Any) -> Any:
    """A number or point of numpy's as Python's, and a place that the API gave as the point that it is."""
    if isinstance(value, Location):
        return [value.lat, value.lon]
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value


def _line(errors: list[ErrorDetails], names: list[str]) -> str:
    """The first mistake. pydantic names a positional argument by its index, and has an error for each member of a union."""
    at = errors[0]["loc"][0]
    name = dict(enumerate(names)).get(at, f"argument {at}") if isinstance(at, int) else at
    messages = dict.fromkeys(
        it["msg"].replace("Input should be", "must be").removesuffix(", unable to interpret input")
        for it in errors
        if it["loc"][0] == at
    )
    told = " or ".join(messages).replace(" or must be", " or")
    return f"{name} {told}, not {errors[0]['input']!r}" if told.startswith("must be") else f"{name}: {told}"


_STEP_MS = 60_000
_STEPS = 200
"""The most steps in which `sure_at` searches: a longer search has longer steps."""
FOR_EVER_S = 1e9
CALLS_PER_TICK = 5_000
T = TypeVar("T")


@checks_arguments
class Queries:
    """Queries about mission time, aMussels as the aPad believes them to be, and docks. musselbed makes it; see `Api`."""

    def __init__(
        self,
        rendezvous: Rendezvous,
        frame: LocalFrame,
        id_self: str,
        agent_ids: Sequence[int],
        tell: Callable[[str], None],
    ) -> None:
        self.id_self = id_self
        self._agent_ids = agent_ids
        self._print = tell
        self._rendezvous = rendezvous
        self._frame = frame
        self._mission: ManualMission | None = None
        self._calls = (0, 0)

    def attach(self, mission: ManualMission) -> None:
        """Connects the API to its mission; musselbed calls it before the script begins."""
        self._mission = mission
        self._pool = ChargingPool(mission.config, mission.beliefs)

    # Time.

    def now(self) -> float:
        """Mission time in seconds."""
        return self._do(lambda mission: mission.now_ms / 1000)

    def sleep(self, seconds: float) -> None:
        """Waits until the first tick at or after `seconds` from now in mission time; ticks are one second apart."""
        if seconds != 0:
            self._rendezvous.request(Wait(None, self._until_ms(seconds)))

    def wait_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Waits until the condition holds, which is checked once a tick. True if it held before the timeout."""
        return cast(bool, self._rendezvous.request(Wait(condition, self._until_ms(timeout))))

    # aMussels and docks, as the aPad believes them to be.

    def agents(self) -> list[int]:
        """The ids of all aMussels that have reported, in rising order."""
        return self._do(lambda mission: [belief.agent_id for belief in mission.beliefs.all()])

    def agent(self, id: int) -> Agent:
        """An aMussel's state, charges, place, age of the last report and dock, in one object."""
        self._await_first_packet(id)
        return self._do(lambda mission: self._agent(mission, id))

    def battery(self, id: int | str) -> float:
        """The charge of an aMussel's primary battery as the paper's scaled voltage: 0 is empty, 1 is full.

        For `id_self` it is that of the aPad's battery.
        """
        if not isinstance(id, str):
            self._await_first_packet(id)
            return self._do(lambda mission: self._belief(mission, id).primary)
        self._refuse_other_names(id)
        if (charge := self._do(lambda mission: mission.apad_battery)) is None:
            raise Refused("the aPad's battery is not known yet")
        return charge

    def belief(self, id: int) -> Belief:
        """The full belief about an aMussel, with its uncertainty."""
        self._await_first_packet(id)
        return self._do(lambda mission: self._belief(mission, id))

    def beliefs(self) -> dict[int, Belief]:
        """The beliefs about all aMussels that have reported, by id."""
        return self._do(lambda mission: {belief.agent_id: belief for belief in mission.beliefs.all()})

    def get_location(self, id: int | str) -> Location:
        """The place of an aMussel, as it last reported or as it is believed now; or of the aPad, for `id_self`."""
        if isinstance(id, str):
            self._refuse_other_names(id)
        else:
            self._await_first_packet(id)
        return self._do(lambda mission: self._location(mission, id))

    def home(self, id: int) -> Location:
        """The place from which an aMussel first reported in the water, to which it should be returned."""

        def find_home(mission: ManualMission) -> Location:
            for agent_id, north_m, east_m in mission.state.homes:
                if agent_id == id:
                    return self._located(north_m, east_m)
            raise Refused(f"aMussel {id} never reported from the water")

        return self._do(find_home)

    def docks(self) -> dict[int, int | None]:
        """The aMussel in each dock, by the dock's number; None for an empty dock."""
        return self._do(
            lambda mission: {dock_of(dock_index): agent for dock_index, agent in enumerate(mission.docks)}
        )

    def free_docks(self) -> list[int]:
        """The numbers of the empty docks."""
        return [dock for dock, agent in self.docks().items() if agent is None]

    def is_full(self, id: int) -> bool:
        """True if an aMussel's believed charge is above the scenario's threshold for full."""
        self._await_first_packet(id)
        return self._do(lambda mission: mission.is_full(id))

    def pool(self) -> list[int]:
        """The ids of the charging candidates: recently heard, in the water, at or below the scenario's threshold."""
        return self._do(
            lambda mission: [
                it.agent_id for it in self._pool.candidates(mission.now_ms, served=mission.state.served)
            ]
        )

    # Forecasts, as if nothing more were received.

    def chance(self, id: int, question: str | Question, at: float | None = None) -> float:
        """The probability that an aMussel is "low", "full" or "lost" at mission time `at` (s); now if not given.

        The scenario's thresholds define low and full. A question may also be a function of a belief.
        """
        now_ms, belief, estimator, resolved = self._forecast_inputs(id, question)
        return chance(estimator, belief, resolved, MissionMs(now_ms) if at is None else _ms(at), now_ms)

    def sure_at(
        self, id: int, question: str | Question, share: float = 0.9, within: float = 3600.0
    ) -> float | None:
        """The mission time (s) from which on `chance` is `share` or more.

        None if that time is more than `within` seconds away.
        """
        now_ms, belief, estimator, resolved = self._forecast_inputs(id, question)
        return sure_at(estimator, belief, resolved, share, now_ms, _ms(within))

    def _forecast_inputs(self, id: int, question: str | Question) -> tuple[int, Belief, Estimator, Question]:
        self._await_first_packet(id)

        def read(mission: ManualMission) -> tuple[int, Belief, Estimator, Question]:
            resolved = question_of(question, mission.config)
            return mission.now_ms, self._belief(mission, id), mission.beliefs.estimator, resolved

        return self._do(read)

    # Calls into the supervisor's thread.

    def _do(self, act: Callable[[ManualMission], T]) -> T:
        mission = self._mission
        assert mission is not None

        def act_counted() -> T:
            tick_ms, calls = self._calls
            self._calls = (mission.now_ms, calls + 1 if tick_ms == mission.now_ms else 1)
            if self._calls[1] > CALLS_PER_TICK:
                raise Refused(
                    f"the API was called {CALLS_PER_TICK} times at one mission time: time passes only while the script "
                    "sleeps or waits, so put a time.sleep into the loop"
                )
            return act(mission)

        return cast(T, self._rendezvous.request(Do(act_counted)))

    def _until_ms(self, seconds: float) -> int:
        if not seconds >= 0:
            raise Refused(f"a time of {seconds:g} s cannot be waited for")
        return self._do(lambda mission: mission.now_ms) + round(min(seconds, FOR_EVER_S) * 1000)

    def _await_first_packet(self, id: int) -> None:
        """Waits for the aMussel's first packet, at most the scenario's `silence_timeout_s`.

        Raises Refused for an id that is not in the scenario.
        """
        if id not in self._agent_ids:
            ids = in_ranges(self._agent_ids) or "none"
            raise Refused(f"aMussel {id!r} is not of this scenario; there are {ids}")
        if self._do(lambda mission: mission.beliefs.get(id)) is not None:
            return
        timeout = self._do(lambda mission: mission.config.silence_timeout_s)
        self.wait_until(lambda: self._do(lambda mission: mission.beliefs.get(id)) is not None, timeout)

    def _refuse_other_names(self, name: str) -> None:
        if name != self.id_self:
            raise Refused(
                f"{name!r} is not this aPad, which is called {self.id_self!r}, and no aMussel's number"
            )

    def _belief(self, mission: ManualMission, id: int) -> Belief:
        if (belief := mission.beliefs.get(id)) is None:
            raise Refused(f"aMussel {id} never reported")  # the wait for its first packet timed out
        return belief

    def _location(self, mission: ManualMission, id: int | str) -> Location:
        if isinstance(id, str):
            if mission.pose is None:
                raise Refused("the aPad's place is not known yet")
            return self._located(*mission.pose)
        belief = self._belief(mission, id)
        return self._located(belief.north_m, belief.east_m)

    def _located(self, north_m: float, east_m: float) -> Location:
        return Location(*self._frame.to_geographic(north_m, east_m), north_m, east_m)

    def _agent(self, mission: ManualMission, id: int) -> Agent:
        belief = self._belief(mission, id)
        dock_index = mission.docks.index(id) if id in mission.docks else None
        return Agent(
            id=id,
            state=belief.state.name,
            battery=belief.primary,
            secondary=belief.secondary,
            location=self._located(belief.north_m, belief.east_m),
            age_s=(mission.now_ms - belief.heard_ms) / 1000,
            dock=None if dock_index is None else dock_of(dock_index),
        )


def _ms(seconds: float) -> MissionMs:
    if not 0 <= seconds <= FOR_EVER_S:
        raise Refused(f"a time of {seconds:g} s cannot be foretold")
    return MissionMs(round(seconds * 1000))


def question_of(question: str | Question, config: Mission) -> Question:
    """The question with a name, by the scenario's thresholds; a function is returned as it is.

    Raises Refused for an unknown name.
    """
    if not isinstance(question, str):
        return question
    named = {
        "low": candidate_below(config.pool_threshold),
        "full": full_above(config.full_threshold),
        "lost": lost,
    }
    if question not in named:
        raise Refused(f"there is no question {question!r}: ask {', '.join(named)}, or a function of a belief")
    return named[question]


def chance(estimator: Estimator, belief: Belief, question: Question, at_ms: MissionMs, now_ms: int) -> float:
    """The probability at mission time `at_ms`, which is `now_ms` or later.

    It is 0 or 1 for a belief that repeats the last packet.
    """
    if at_ms < now_ms:
        raise Refused(f"{at_ms / 1000:.0f} s are over: it is {now_ms / 1000:.0f} s")
    if at_ms > now_ms:
        _refuse_held(belief)
    return probability_at(estimator, belief, question, at_ms)


def sure_at(
    estimator: Estimator, belief: Belief, question: Question, share: float, now_ms: int, within_ms: int
) -> float | None:
    """The mission time (s) from which on the probability is `share` or more; None if not within `within_ms`."""
    if not 0 < share <= 1:
        raise Refused(f"a share of {share}: it must be above 0 and at most 1")
    _refuse_held(belief)
    step_ms = max(_STEP_MS, math.ceil(within_ms / _STEPS))
    found_ms = sure_at_ms(estimator, belief, question, share, now_ms + within_ms, step_ms)
    return None if found_ms is None else found_ms / 1000


def _refuse_held(belief: Belief) -> None:
    """Raises Refused for a belief that repeats the last packet and is not carried on in time."""
    if not belief.is_predicted:
        raise Refused(
            "this scenario's estimator holds the last packet and predicts nothing: set beliefs: {estimator: twin} in it"
        )
