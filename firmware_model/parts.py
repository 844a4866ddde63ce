"""What a board is made of, and what whoever hosts it may read there."""

from __future__ import annotations

from firmware_model.charge import Battery
from firmware_model.charge_pin import ChargePin
from firmware_model.keeper import Keeper, Kept
from firmware_model.plan import BoardConfig
from firmware_model.power_path import Feed, PowerPath, WorstCase
from firmware_model.rails import Rail
from firmware_model.states import State
from firmware_model.stimuli import ResetCause
from firmware_model.switchboard import Switchboard

_OFFSETS_MS = (-(1 << 31), (1 << 31) - 1)


class Parts:
    """The paper's worst case has a pin and its batteries; the whole firmware has switches, a clock and settings too."""

    def __init__(
        self, config: BoardConfig, primary: Battery, secondary: Battery, now_ms: int, kept: Kept | None
    ) -> None:
        self.config = config
        self.state = State.OFF
        self.reset_cause: ResetCause | None = None
        self._pin = ChargePin(config.pin_debounce_ms, False, config.pin_chatter_ms, config.pin_check_ms)
        self._batteries: WorstCase | PowerPath
        self._keeper: Keeper | None = None
        self._switches: Switchboard | None = None
        if config.whole is None:
            self._batteries = WorstCase(config.charge, primary, secondary)
        else:
            self._keeper = Keeper(config, kept, now_ms)
            self._batteries = PowerPath(
                config.charge,
                config.whole.power,
                primary,
                secondary,
                now_ms,
                config.agent_id,
                self._keeper.settings.levels,
            )
            self._switches = Switchboard(config.whole, self._batteries)

    @property
    def primary(self) -> Battery:
        return self._batteries.primary

    @property
    def secondary(self) -> Battery:
        return self._batteries.secondary

    @property
    def feed(self) -> Feed:
        """The battery that the board lives on."""
        return self._batteries.feed

    @property
    def rails(self) -> int:
        """What is on, as bits; always 0 in the worst case, which knows one load only."""
        return 0 if self._switches is None else self._switches.rails

    @property
    def hears(self) -> bool:
        """Whether the modem listens. The worst case's always does."""
        return self._switches is None or self._switches.is_on(Rail.MODEM_LISTENING, Rail.MODEM_RECEIVING)

    @property
    def has_wifi(self) -> bool:
        """Whether Wi-Fi is on. The worst case's always is."""
        return self._switches is None or self._switches.is_on(Rail.WIFI)

    @property
    def kept(self) -> Kept | None:
        """What a reset has to leave: None for a board that nobody has told anything yet."""
        return None if self._keeper is None else self._keeper.kept

    @property
    def clock_offset_ms(self) -> int:
        """By how much the clock was ahead of the last beacon; within 32 bits."""
        low_ms, high_ms = _OFFSETS_MS
        return 0 if self._keeper is None else max(low_ms, min(high_ms, self._keeper.clock.corrected_ms))

    def clock_ms(self, now_ms: int) -> int:
        """What the board's own clock reads; the paper's worst case has one that is never off."""
        return now_ms if self._keeper is None else self._keeper.clock.reading_at(now_ms)

    def readings(self, now_ms: int) -> tuple[int, int]:
        """Primary and secondary as the board knows them, in grains: the monitor's last samples."""
        return self._batteries.readings(now_ms)
