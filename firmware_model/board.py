"""The MU board: its state machine, its batteries and its timers, moved by the three verbs in agent time."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_model.actions import Action, Buoyancy, Dropped, RunBuoyancy, StateChanged
from firmware_model.charge import Battery, ChargeModel, Flow
from firmware_model.charge_pin import ChargePin, Edge
from firmware_model.codec import Codec
from firmware_model.packets import CommandPacket, Kind
from firmware_model.states import Refused, State, Trigger, next_state
from firmware_model.stimuli import (
    BottomReached,
    ChargePinFell,
    ChargePinRose,
    PacketHeard,
    PowerCameOn,
    Stimulus,
    SurfaceReached,
    WifiReceived,
)


@dataclass(frozen=True, slots=True)
class BoardConfig:
    """Numbers of one board; milliseconds of agent time."""

    agent_id: int
    charge: ChargeModel
    pin_debounce_ms: int
    boot_ms: int
    float_timeout_ms: int
    release_wait_ms: int


class Board:
    """One MU board. It is OFF until it receives `PowerCameOn`; its batteries live on whether it runs or not."""

    def __init__(
        self, config: BoardConfig, codec: Codec, primary: Battery, secondary: Battery, now_ms: int
    ) -> None:
        self.config = config
        self.state = State.OFF
        self.primary = primary
        self.secondary = secondary
        self._codec = codec
        self._now_ms = now_ms
        self._pin = ChargePin(config.pin_debounce_ms, high=False)
        self._at_surface = False
        self._clear_to_sink = False
        self._deadline_ms: int | None = None

    @property
    def next_due_ms(self) -> int | None:
        """When a timer of the board fires next; of two at once the pin's goes first."""
        if self._pin.next_due_ms is None or self._deadline_ms is None:
            return self._pin.next_due_ms if self._deadline_ms is None else self._deadline_ms
        return min(self._pin.next_due_ms, self._deadline_ms)

    def advance(self, now_ms: int) -> list[Action]:
        """Fires every timer that is due by `now_ms`, in order, each at its own time (ValueError if time went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        actions: list[Action] = []
        while (due_ms := self.next_due_ms) is not None and due_ms <= now_ms:
            self._now_ms = due_ms
            if due_ms == self._pin.next_due_ms:
                edge = self._pin.due(due_ms)
                actions += self._edge(edge) if edge is not None else []
            else:
                self._deadline_ms = None
                actions += self._pull(self._deadline_trigger())
        self._now_ms = now_ms
        return actions

    def receive(self, stimulus: Stimulus, now_ms: int) -> list[Action]:
        """Takes a fact from outside at `now_ms`, after everything that was due by then."""
        actions = self.advance(now_ms)
        match stimulus:
            case ChargePinRose():
                self._pin.level(True, now_ms)
            case ChargePinFell():
                self._pin.level(False, now_ms)
            case PacketHeard(data) | WifiReceived(data):
                actions += self._command(data)
            case SurfaceReached():
                self._at_surface = True
                actions += self._pull(Trigger.SURFACE_REACHED)
            case BottomReached():
                self._at_surface = False
                actions += self._pull(Trigger.BOTTOM_REACHED)
            case PowerCameOn(_, at_surface, pin_high):
                self._at_surface = at_surface
                self._pin = ChargePin(self.config.pin_debounce_ms, pin_high)
                actions += self._pull(Trigger.POWER_CAME_ON)
        return actions

    def _command(self, data: bytes) -> list[Action]:
        packet = self._codec.decode(data)
        if not isinstance(packet, CommandPacket):
            return [Dropped(self._now_ms, "not a command")]
        if packet.agent_id != self.config.agent_id:
            return [Dropped(self._now_ms, "for another aMussel")]
        if packet.kind is Kind.PERMISSION:
            return self._pull(Trigger.PERMISSION_HEARD)
        if self.state is State.CHARGING:
            # The packet and the contact travel apart: it may come before the falling edge is certain.
            self._clear_to_sink = True
            return []
        return self._pull(Trigger.CLEAR_TO_SINK)

    def _edge(self, edge: Edge) -> list[Action]:
        if self.state in (State.OFF, State.BOOTING):
            return []  # the level is read again when the board has booted
        if edge is Edge.ROSE:
            self._clear_to_sink = False
            return self._pull(Trigger.CHARGE_EDGE_ROSE)
        actions = self._pull(Trigger.CHARGE_EDGE_FELL)
        if self._clear_to_sink and self.state is State.RELEASED:
            actions += self._pull(Trigger.CLEAR_TO_SINK)
        return actions

    def _deadline_trigger(self) -> Trigger:
        if self.state is State.BOOTING:
            if self._pin.high:
                return Trigger.BOOTED_ON_CHARGER
            return Trigger.BOOTED_AT_SURFACE if self._at_surface else Trigger.BOOTED_ON_BOTTOM
        return _DEADLINE_TRIGGERS[self.state]

    def _pull(self, trigger: Trigger) -> list[Action]:
        old = self.state
        try:
            self.state = next_state(old, trigger)
        except Refused as refusal:
            return [Dropped(self._now_ms, str(refusal))]
        return [StateChanged(self._now_ms, old, trigger, self.state), *self._enter()]

    def _enter(self) -> list[Action]:
        """Sets the power path, the deadline and the motors for the state just entered."""
        now_ms, config = self._now_ms, self.config
        if self.state is not State.BOOTING:
            flow = Flow.CHARGING if self.state is State.CHARGING else Flow.DISCHARGING
            if flow is not self.primary.flow:
                self.primary = config.charge.settle(self.primary, now_ms, flow)
        match self.state:
            case State.BOOTING:
                self._deadline_ms = now_ms + config.boot_ms
            case State.ACTIVE:
                empty_at_ms = config.charge.empty_at_ms(self.primary)
                self._deadline_ms = None if empty_at_ms is None else max(now_ms, empty_at_ms)
            case State.FLOATING:
                self._deadline_ms = now_ms + config.float_timeout_ms
            case State.RELEASED:
                self._deadline_ms = now_ms + config.release_wait_ms
            case _:
                self._deadline_ms = None
        if self.state is State.SURFACING:
            return [RunBuoyancy(now_ms, Buoyancy.FLOAT)]
        if self.state is State.SINKING:
            return [RunBuoyancy(now_ms, Buoyancy.SINK)]
        return []


_DEADLINE_TRIGGERS = {
    State.ACTIVE: Trigger.BATTERY_EMPTIED,
    State.FLOATING: Trigger.FLOAT_TIMED_OUT,
    State.RELEASED: Trigger.CLEAR_TO_SINK,
}
