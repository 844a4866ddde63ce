"""One simulated aMussel: the body in the water, the board in the body, and its Wi-Fi reports. Agent time throughout."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

from agents.modem.frames import SHORT_MS
from agents.mussel.body import Body, WaterConfig, WorldEffect, placed
from agents.mussel.firmware_failure import PowerLost
from agents.mussel.outputs import (
    Output,
    PingAnswered,
    StateDoubted,
    StimulusDropped,
    Truth,
)
from agents.mussel.physical import Physical
from agents.mussel.reporter import ReportConfig, Reporter
from agents.mussel.stimuli import (
    AgentStimulus,
    CoilSlipped,
    ContactClosed,
    ContactOpened,
    Defect,
    DockMoved,
    ModemSent,
    PingArrived,
    Placed,
    SoundArrived,
    WasReset,
    WifiArrived,
)
from firmware_model import actions as board_actions
from firmware_model import stimuli as board_stimuli
from firmware_model.actions import Buoyancy
from firmware_model.board import Board
from firmware_model.config import BoardConfig
from firmware_model.packets.codec import Codec
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

if TYPE_CHECKING:
    from agents.mussel.board_parts import BoardPart
    from agents.mussel.defects import Defects
    from agents.mussel.failing_flash import FailingFlash
    from agents.mussel.logbook import Logbook
    from agents.mussel.port.others_firmware import OthersFirmware
    from agents.mussel.port.peripherals import MeasuredWorld
    from firmware_model.sampling.flash import Flash


@dataclass(frozen=True, slots=True)
class AgentConfig:
    """An agent's configuration: everything but its physical state."""

    board: BoardConfig
    water: WaterConfig
    reports: ReportConfig
    firmware: tuple[str, ...] = ()
    """Somebody's firmware on its board, as `port_firmware.link_to` takes it; empty for ours."""


class Agent:
    """The three verbs around a body and its board.

    Events that are due at one time go in this order: the body's arrival, drift, the board's timers, the charger, the
    report. So the report has the newest values. A Truth follows every event that changed anything.
    """

    def __init__(
        self,
        config: AgentConfig,
        codec: Codec,
        physical: Physical,
        now_ms: int,
        cause: ResetCause,
        flash: Flash | None = None,
        others: OthersFirmware | None = None,
    ) -> None:
        """`flash` outlives the agent; without one, a whole board's log ends with the agent.

        `others` is somebody's firmware; without it the agent makes that of its configuration.
        """
        self.config = config
        self._codec = codec
        self._failing: dict[BoardPart, int] = {}
        """The parts of the board that fail, with their values."""
        self._defects: Defects | None = None
        """None until a first defect: few agents are ever defective."""
        self._flash = None if config.board.whole is None else self._flash_of_board(flash)
        self._others = others or (self._firmware_of_others() if config.firmware else None)
        self._truths: list[Truth] = []
        self._last: tuple[State, Physical] | None = None
        self._boot_outputs = self._power_on(physical, now_ms, cause)
        self._note_truth(now_ms)
        self._timer = self._next_timer()

    def copy(self) -> Agent:
        """An agent in the same state that goes on by itself. TypeError for a whole board, whose log is not its own."""
        other = copy(self)
        other.body, other.board = copy(self.body), self.board.copy()
        other._reporter = self._reporter.copy(other.board, other.body)
        other._failing = dict(self._failing)
        other._defects = None if self._defects is None else self._defects.copy(other._failing)
        other._truths, other._boot_outputs = list(self._truths), list(self._boot_outputs)
        other._timer = other._next_timer()
        return other

    def _power_on(self, physical: Physical, now_ms: int, cause: ResetCause) -> list[Output]:
        """Starts from the physical state and forgets everything else from before."""
        config = self.config
        self._now_ms = now_ms
        self.body = Body(config.board.agent_id, config.water, physical, now_ms)
        self.close()
        self._logbook, self._world = self._log_of_board(physical)
        self.board = Board(
            config.board,
            self._codec,
            physical.primary,
            physical.secondary,
            now_ms,
            physical.kept,
            None if self._others is None else self._others.maker(self._world),
        )
        self._reporter = Reporter(self.board, self.body, self._logbook, config.reports.modem, self._codec)
        if self._defects is not None:
            self.board.receive(self._defects.of_converter(), now_ms)
        # A reset agent may have reported at this very time before it died: its next report is a later one.
        later = 0 if cause is ResetCause.POWER_ON else 1
        self._report_due_ms = self._report_after(now_ms + later)
        power = board_stimuli.PowerCameOn(cause, self.body.depth_at_um(now_ms) == 0, self.body.pin_high)
        return self._stimulate_board(power, now_ms)

    # What few agents have is imported where they get it: every page of memory of an agent counts.

    def _flash_of_board(self, kept: Flash | None) -> FailingFlash:
        from agents.mussel.failing_flash import FailingFlash
        from firmware_model.sampling.flash import MemoryFlash

        return FailingFlash(kept or MemoryFlash(), self._failing)

    def _firmware_of_others(self) -> OthersFirmware:
        from agents.mussel.port.others_firmware import OthersFirmware

        config = self.config
        return OthersFirmware(config.firmware, config.board, config.water.seed, config.reports.modem)

    def _log_of_board(self, physical: Physical) -> tuple[Logbook | None, MeasuredWorld | None]:
        """A whole board's log for our firmware, or what somebody's firmware keeps its own log by."""
        if (flash := self._flash) is None:
            return None, None
        from agents.mussel.sensor_bus import SensorBus

        water, body = self.config.water, self.body
        sensors = SensorBus(self._agent_id, water.seed, water.fields, body.place_um, self._failing)
        registers = physical.samples, physical.acknowledged
        if self._others is None:
            from agents.mussel.logbook import Logbook

            return Logbook(self._agent_id, sensors, flash, *registers), None
        from agents.mussel.port.peripherals import MeasuredWorld

        return None, MeasuredWorld(flash, body, sensors.read, *registers)

    def close(self) -> None:
        """Ends the link to somebody's firmware, if its board has one."""
        if self._others is not None:
            self._others.close()

    @property
    def physical(self) -> Physical:
        """The physical state after the last event: nothing else changes it."""
        assert self._last is not None  # noted at the end of __init__
        return self._last[1]

    def _physical_now(self) -> Physical:
        body, board = self.body, self.board
        log = self._logbook or self._world
        samples, acknowledged = (0, 0) if log is None else log.registers
        return Physical(
            board.primary,
            board.secondary,
            body.north_um,
            body.east_um,
            body.depth_anchor_ms,
            body.depth_um,
            body.buoyancy,
            body.docked,
            body.pin_due_ms,
            body.hover_um,
            samples,
            acknowledged,
            body.fix_um,
            board.kept,
        )

    @property
    def next_due_ms(self) -> int | None:
        return None if self._timer is None else self._timer[0]

    def take_truths(self) -> list[Truth]:
        """The truths since the last call, in order."""
        truths, self._truths = self._truths, []
        return truths

    def advance(self, now_ms: int) -> list[Output]:
        """Lets time pass to `now_ms`; ValueError if it went back."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        outputs, self._boot_outputs = self._boot_outputs, []
        while self._timer is not None and self._timer[0] <= now_ms:
            due_ms, fire = self._timer
            self._now_ms = due_ms
            try:
                outputs += fire(due_ms)
            except PowerLost:
                outputs += self._brown_out(due_ms)
            if self._others is not None:
                outputs += self._doubted(due_ms)
            self._timer = self._next_timer()
        self._now_ms = now_ms
        return outputs

    def receive(self, stimulus: AgentStimulus, now_ms: int) -> list[Output]:
        """Takes a fact from the world at `now_ms`, after everything that was due by then."""
        outputs = self.advance(now_ms)
        try:
            outputs += self._take(stimulus, now_ms)
        except PowerLost:
            outputs += self._brown_out(now_ms)
        outputs += self._doubted(now_ms)
        self._note_truth(now_ms)
        self._timer = self._next_timer()
        return outputs

    def _doubted(self, now_ms: int) -> list[Output]:
        """A doubt of the state that somebody's firmware tells. A defect may explain it, so a defective board is spared."""
        if self._others is None or self._defects is not None:
            return []
        reason = self._others.doubt(self.board, self.body, now_ms)
        return [] if reason is None else [StateDoubted(now_ms, self._agent_id, reason)]

    def _brown_out(self, now_ms: int) -> list[Output]:
        """Resets the board whose supply failed in the middle of a write."""
        outputs = self._power_on(self._physical_now(), now_ms, ResetCause.BROWN_OUT)
        if self.board.next_due_ms != now_ms:
            # Else a program boots at this very time, and its truth has the registers that it finds and mends.
            self._note_truth(now_ms)
        return outputs

    def _next_timer(self) -> tuple[int, Callable[[int], list[Output]]] | None:
        """When the next timer is due, and what it does then; of those due at one time the first in the stated order.

        Only events change it: time that passes does not.
        """
        # Written out, because agents do this more often than anything else.
        body = self.body
        first_ms, fire = body.arrival_ms, self._arrive
        due_ms = body.drift_due_ms
        if due_ms is not None and (first_ms is None or due_ms < first_ms):
            first_ms, fire = due_ms, self._drift
        due_ms = self.board.next_due_ms
        if due_ms is not None and (first_ms is None or due_ms < first_ms):
            first_ms, fire = due_ms, self._advance_board
        due_ms = body.pin_due_ms
        if due_ms and (first_ms is None or due_ms < first_ms):
            first_ms, fire = due_ms, self._align
        due_ms = self._report_due_ms
        if (first_ms is None or due_ms < first_ms) and (
            # A body under water keeps the time of the report that it last missed.
            self.config.reports.heard_always or self._at_surface(max(due_ms, self._now_ms))
        ):
            first_ms, fire = due_ms, self._report
        return None if first_ms is None else (first_ms, fire)

    def _arrive(self, now_ms: int) -> list[Output]:
        """The body has reached the surface or the bottom."""
        self.body.settle_depth(now_ms)
        self._report_due_ms = max(self._report_due_ms, self._report_after(now_ms))
        outputs = self._depth_noticed(now_ms)
        self._note_truth(now_ms)
        return outputs

    def _depth_noticed(self, now_ms: int) -> list[Output]:
        """The pressure sensor shows the surface or the bottom."""
        surfaced = self._at_surface(now_ms)
        reached = board_stimuli.SurfaceReached() if surfaced else board_stimuli.BottomReached()
        return self._stimulate_board(reached, now_ms)

    def _drift(self, now_ms: int) -> list[Output]:
        self.body.drift(now_ms)
        self._note_truth(now_ms)
        return []

    def _advance_board(self, now_ms: int) -> list[Output]:
        outputs = self._carry_out(self.board.advance(now_ms))
        outputs += self._reset_if_due(now_ms)
        self._note_truth(now_ms)
        return outputs

    def _reset_if_due(self, now_ms: int) -> list[Output]:
        """Boots a board whose watchdog fired, or whose power came back."""
        cause = self.board.reset_due
        return [] if cause is None else self._power_on(self._physical_now(), now_ms, cause)

    def _align(self, now_ms: int) -> list[Output]:
        """The coils have come together: the charger raises its pin."""
        edge = None if self._defects is None else self._defects.bounce(self.body, now_ms)
        if edge is None:
            self.body.align()
            edge = board_stimuli.ChargePinRose()
        outputs = self._stimulate_board(edge, now_ms)
        self._note_truth(now_ms)
        return outputs

    def _report(self, now_ms: int) -> list[Output]:
        self._report_due_ms += self.config.reports.period_ms
        # In the paper's mode the report is the experiment's; else it needs the board's Wi-Fi, which the worst case has.
        is_off = not self.config.reports.heard_always and not self.board.has_wifi
        if self.board.state is State.BOOTING or is_off:
            return []
        asked = None if self._others is None else self._others.report(self.board, now_ms)
        if asked is not None:
            outputs = self._carry_out(asked)
            self._note_truth(now_ms)
            return outputs
        status = self._reporter.status(now_ms)
        if self.body.has_receiver:
            # A report may take a fix, and changes nothing else.
            self._note_truth(now_ms)
        return [status]

    def _take(self, stimulus: AgentStimulus, now_ms: int) -> list[Output]:
        match stimulus:
            case ContactClosed() | DockMoved() | ContactOpened() | CoilSlipped():
                effects = self.body.touch(stimulus, now_ms)
                if self._defects is not None and not self.body.docked:
                    self._defects.dock_opened()
                return self._apply(effects, now_ms)
            case SoundArrived() | PingArrived() if self._at_surface(now_ms):
                return [self._dropped(now_ms, "sound does not reach a modem in air")]
            case SoundArrived(data):
                return self._stimulate_board(board_stimuli.PacketHeard(data), now_ms)
            case PingArrived(travelled_us):
                if not self.board.is_modem_listening:
                    return [self._dropped(now_ms, "the modem is not listening")]
                lasting_ms = SHORT_MS[self.config.reports.modem]
                status = self._stimulate_board(board_stimuli.ModemSpoke(lasting_ms), now_ms)
                return [*status, PingAnswered(now_ms, self._agent_id, travelled_us)]
            case ModemSent(lasting_ms):
                return self._stimulate_board(board_stimuli.ModemSpoke(lasting_ms), now_ms)
            case WifiArrived(data):
                if not self.config.reports.heard_always and not self._at_surface(now_ms):
                    return [self._dropped(now_ms, "Wi-Fi does not reach under water")]
                return self._stimulate_board(board_stimuli.WifiReceived(data), now_ms)
            case Placed():
                physical = placed(stimulus, self.physical, self._agent_id, self.config.water, now_ms)
                return self._power_on(physical, now_ms, ResetCause.POWER_ON)
            case WasReset(cause):
                return self._power_on(self.physical, now_ms, ResetCause(cause))
            case _:
                return self._take_defect(stimulus, now_ms)

    def _take_defect(self, defect: Defect, now_ms: int) -> list[Output]:
        from agents.mussel.defects import Defects

        self._defects = self._defects or Defects(self._failing)
        is_whole = self.config.board.whole is not None
        return self._apply(self._defects.take(defect, self.body, is_whole, now_ms), now_ms)

    def _apply(self, effects: list[WorldEffect], now_ms: int) -> list[Output]:
        outputs: list[Output] = []
        for effect in effects:
            match effect:
                case board_actions.RunBuoyancy():
                    outputs += self._run_buoyancy(effect, now_ms)
                case board_actions.Dropped():
                    outputs.append(self._dropped(now_ms, effect.reason))
                case _:
                    outputs += self._stimulate_board(effect, now_ms)
        return outputs

    def _report_after(self, now_ms: int) -> int:
        period_ms = self.config.reports.period_ms
        return -(-now_ms // period_ms) * period_ms

    def _at_surface(self, now_ms: int) -> bool:
        return self.body.depth_at_um(now_ms) == 0

    def _stimulate_board(self, stimulus: board_stimuli.Stimulus, now_ms: int) -> list[Output]:
        """Lets the board take a fact, as its defects let it pass."""
        if self._defects is not None:
            if (noticed := self._defects.passed(stimulus)) is None:
                return []
            stimulus = noticed
        outputs = self._carry_out(self.board.receive(stimulus, now_ms))
        return outputs + self._reset_if_due(now_ms)

    def _carry_out(self, actions: list[board_actions.Action]) -> list[Output]:
        outputs: list[Output] = []
        for action in actions:
            match action:
                case board_actions.RunBuoyancy():
                    outputs += self._run_buoyancy(action, action.at_ms)
                case board_actions.MotorsStalled(at_ms, to):
                    outputs.append(self._dropped(at_ms, "a motor run: neither battery holds its charge"))
                    outputs += self._stays_there(to, at_ms)
                case board_actions.Dropped(at_ms, reason):
                    outputs.append(self._dropped(at_ms, reason))
                case _:
                    # The truth that follows has a new state and the charge flows.
                    outputs += self._reporter.carry_out(action)
        return outputs

    def _run_buoyancy(self, run: board_actions.RunBuoyancy, now_ms: int) -> list[Output]:
        if self._defects is not None and self._defects.hold_up(run):
            return []
        self.body.run_buoyancy(run.to, now_ms, run.depth_mm)
        return self._depth_noticed(now_ms) if run.to is Buoyancy.SINK and self.body.rests_on_bottom else []

    def _stays_there(self, to: Buoyancy, now_ms: int) -> list[Output]:
        """The pressure sensor of a board whose motors did not run shows where the body rests."""
        rests = self._at_surface(now_ms) or (to is Buoyancy.SINK and self.body.rests_on_bottom)
        return self._depth_noticed(now_ms) if rests else []

    def _dropped(self, now_ms: int, reason: str) -> StimulusDropped:
        return StimulusDropped(now_ms, self._agent_id, reason)

    @property
    def _agent_id(self) -> int:
        return self.config.board.agent_id

    def _note_truth(self, now_ms: int) -> None:
        now = (self.board.state, self._physical_now())
        if now != self._last:
            self._last = now
            self._truths.append(Truth(now_ms, self.config.board.agent_id, *now))
