"""One board on the bench: gives it stimuli, lets time pass, records its actions. Each call continues the time."""

from __future__ import annotations

from typing import TypeVar

from firmware_model.actions import Action, Buoyancy, MotorsStalled, RunBuoyancy
from firmware_model.board import Board, MakeFirmware
from firmware_model.config import BoardConfig
from firmware_model.packets import CommandPacket, Kind, Packet
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.packets.wire import PLAIN
from firmware_model.power.charge import MS_PER_HOUR, MS_PER_MIN, Battery, Flow, fraction, grains
from firmware_model.power.energy_ledger import EnergyLedger
from firmware_model.settings import StoredSettings
from firmware_model.states import State
from firmware_model.stimuli import (
    BottomReached,
    ChargePinFell,
    ChargePinRose,
    PacketHeard,
    PowerCameOn,
    ResetCause,
    Stimulus,
    SurfaceReached,
    WifiReceived,
)

A = TypeVar("A", bound=Action)


class Bench:
    """Powers a board up at 0 and simulates its body: `travel_ms` after a motor run it arrives at the run's target."""

    def __init__(
        self,
        config: BoardConfig,
        *,
        primary: float = 1.0,
        secondary: float = 1.0,
        docked: bool = False,
        travel_ms: int = MS_PER_MIN,
        firmware: MakeFirmware | None = None,
    ) -> None:
        """`firmware` makes another program than ours for each reset of the board."""
        self.config = config
        self._firmware = firmware
        self.now_ms = 0
        self.trace: list[Action] = []
        self.told: list[tuple[int, Stimulus]] = []
        """The stimuli of the board, each with its time."""
        self.travel_ms = travel_ms
        self._arrival: tuple[int, Stimulus] | None = None
        self._docked = docked
        self._at_surface = docked
        flow = Flow.CHARGING if docked else Flow.RESTING
        coils = 2 if config.charge.segments_by_two else 1
        self.board = self._new_board(
            Battery(0, grains(primary), flow, 0, coils), Battery(0, grains(secondary), flow, 0, 1)
        )
        self.courses: list[tuple[int, Battery, Battery]] = []
        """(from ms, primary, secondary): the course of the batteries, piece by piece."""
        self.ledger = None if config.whole is None else EnergyLedger(config.whole.power.loads, 0)
        self.reset(ResetCause.POWER_ON)

    def _new_board(self, primary: Battery, secondary: Battery, kept: StoredSettings | None = None) -> Board:
        return Board(self.config, MusselbedCodec(), primary, secondary, self.now_ms, kept, self._firmware)

    @property
    def state(self) -> State:
        """The state of the board's firmware, now."""
        return self.board.state

    @property
    def primary(self) -> int:
        """The charge in grains, now."""
        return self.config.charge.charge_at(self.board.primary, self.now_ms)

    @property
    def secondary(self) -> int:
        """The charge in grains, now."""
        return self.config.charge.charge_at(self.board.secondary, self.now_ms)

    @property
    def primary_fraction(self) -> float:
        """The charge in [0, 1], now."""
        return fraction(self.primary)

    @property
    def secondary_fraction(self) -> float:
        """The charge in [0, 1], now."""
        return fraction(self.secondary)

    def did(self, kind: type[A], since_ms: int = 0) -> list[A]:
        """The actions of one kind from `since_ms` on."""
        return [action for action in self.trace if isinstance(action, kind) and action.at_ms >= since_ms]

    def run(self, *, hours: float = 0, minutes: float = 0, seconds: float = 0, ms: int = 0) -> list[Action]:
        """Lets time pass; returns the board's actions meanwhile."""
        passing_ms = round(hours * MS_PER_HOUR + minutes * MS_PER_MIN + seconds * 1000)
        return self.run_until(self.now_ms + passing_ms + ms)

    def run_until(self, until_ms: int) -> list[Action]:
        """Runs up to a time; an arrival precedes a timer of the board that is due at the same time."""
        done = len(self.trace)
        while True:
            due_ms, arrival = self.board.next_due_ms, self._arrival
            if arrival is not None and arrival[0] <= until_ms and (due_ms is None or arrival[0] <= due_ms):
                self._arrival = None
                self.now_ms, there = arrival
                self._at_surface = isinstance(there, SurfaceReached)
                self.tell(there)
            elif due_ms is not None and due_ms <= until_ms:
                self.now_ms = due_ms
                self._note(self.board.advance(due_ms))
                self._reset_if_due()
            else:
                break
        self.now_ms = until_ms
        self._note(self.board.advance(until_ms))
        return self.trace[done:]

    def _reset_if_due(self) -> None:
        if (cause := self.board.reset_due) is not None:
            self.reset(cause)

    def tell(self, stimulus: Stimulus) -> list[Action]:
        """Gives the board a stimulus now."""
        done = len(self.trace)
        self.told.append((self.now_ms, stimulus))
        self._note(self.board.receive(stimulus, self.now_ms))
        self._reset_if_due()
        return self.trace[done:]

    def arrives(self, there: SurfaceReached | BottomReached) -> list[Action]:
        """Brings the body there now, whatever its motors did: by hand, or in a net."""
        self._arrival = None
        self._at_surface = isinstance(there, SurfaceReached)
        return self.tell(there)

    def command(self, kind: Kind) -> list[Action]:
        """A packet for this board: by the medium of its kind."""
        data = CommandPacket(kind, self.config.agent_id).encode()
        return self.tell(WifiReceived(data) if PLAIN[kind].by_wifi else PacketHeard(data))

    def hear(self, packet: Packet) -> list[Action]:
        """Delivers any packet by sound."""
        return self.tell(PacketHeard(packet.encode()))

    def charge_pin_rises(self, *, noticed: bool = True) -> list[Action]:
        """Docks the aMussel now; `noticed` False loses the edge's interrupt."""
        self._docked = self._at_surface = True
        self._arrival = None
        return self.tell(ChargePinRose(noticed))

    def charge_pin_falls(self, *, noticed: bool = True) -> list[Action]:
        """Takes the aMussel out of its dock now; `noticed` False loses the edge's interrupt."""
        self._docked = False
        return self.tell(ChargePinFell(noticed))

    def charge_pin_chatters(self, *, high_ms: int, low_ms: int, times: int) -> list[Action]:
        """Lets the pin rise and fall `times` times; returns the board's actions meanwhile."""
        done = len(self.trace)
        for _ in range(times):
            self.charge_pin_rises()
            self.run(ms=high_ms)
            self.charge_pin_falls()
            self.run(ms=low_ms)
        return self.trace[done:]

    def reset(self, cause: ResetCause) -> list[Action]:
        """Restarts the firmware; batteries and body stay as they were."""
        old = self.board
        old.firmware.close()
        self.board = self._new_board(old.primary, old.secondary, old.kept)
        if self.ledger is not None:
            self.ledger.power_off(self.now_ms)
        return self.tell(PowerCameOn(cause, self._at_surface, self._docked))

    def close(self) -> None:
        """Ends the program on the board, if it is somebody's."""
        self.board.firmware.close()

    def _note(self, actions: list[Action]) -> None:
        self.trace += actions
        primary, secondary = self.board.primary, self.board.secondary
        if not self.courses or self.courses[-1][1] is not primary or self.courses[-1][2] is not secondary:
            self.courses.append((max(primary.anchor_ms, secondary.anchor_ms), primary, secondary))
        if self.ledger is not None:
            self.ledger.take(actions)
        for action in actions:
            if isinstance(action, RunBuoyancy) and action.to is not Buoyancy.HOVER:
                there = SurfaceReached() if action.to is Buoyancy.FLOAT else BottomReached()
                self._arrival = (action.at_ms + self.travel_ms, there)
            elif isinstance(action, MotorsStalled) and (self._at_surface or action.to is Buoyancy.SINK):
                # The pressure sensor shows at once where the body still is.
                self._arrival = (action.at_ms, SurfaceReached() if self._at_surface else BottomReached())
