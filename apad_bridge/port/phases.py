"""What each event does in each phase of a primitive: one table, two rules.

An event that the table does not name in the present phase is dropped and counted, never raised: it is a late or a wrong
word from the vehicle. Nothing else decides what a primitive does next.
"""

from __future__ import annotations

from enum import Enum, auto


class Phase(Enum):
    IDLE = auto()
    GOING = auto()
    HOLDING = auto()
    WAITING = auto()
    """A dock or undock before its mechanism is commanded: the virtual profile's time."""
    ACTING = auto()
    """The mechanism was commanded; only the vehicle's word or the time-out ends this."""


class Event(Enum):
    ARRIVED = auto()
    COMMAND_FAILED = auto()
    MECHANISM_DONE = auto()
    """The dock closed around, or opened for, the aMussel of the running primitive."""
    WAIT_OVER = auto()
    TIMED_OUT = auto()
    REPLACED = auto()
    """The mission ordered another primitive."""


class Effect(Enum):
    SUCCEED = auto()
    FAIL = auto()
    ACT = auto()
    """Command the mechanism."""
    QUEUE = auto()
    """Keep the new primitive until the running one ends."""
    AGAIN = auto()
    """Try the mechanism once more, or fail when it was tried often enough."""
    START = auto()


TABLE: dict[tuple[Phase, Event], Effect] = {
    (Phase.IDLE, Event.REPLACED): Effect.START,
    (Phase.GOING, Event.ARRIVED): Effect.SUCCEED,
    (Phase.GOING, Event.COMMAND_FAILED): Effect.FAIL,
    (Phase.GOING, Event.TIMED_OUT): Effect.FAIL,
    (Phase.GOING, Event.REPLACED): Effect.FAIL,
    (Phase.HOLDING, Event.COMMAND_FAILED): Effect.FAIL,
    (Phase.HOLDING, Event.REPLACED): Effect.SUCCEED,
    (Phase.WAITING, Event.MECHANISM_DONE): Effect.SUCCEED,
    (Phase.WAITING, Event.WAIT_OVER): Effect.ACT,
    (Phase.WAITING, Event.REPLACED): Effect.FAIL,
    (Phase.ACTING, Event.MECHANISM_DONE): Effect.SUCCEED,
    (Phase.ACTING, Event.COMMAND_FAILED): Effect.AGAIN,
    (Phase.ACTING, Event.TIMED_OUT): Effect.FAIL,
    (Phase.ACTING, Event.REPLACED): Effect.QUEUE,
}
