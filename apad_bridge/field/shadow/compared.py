"""A shadow's findings: each decision of theirs beside ours, and the accuracy of our estimates."""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.field.field_log.log_facts import Place

WAIT = "wait"
ELSEWHERE = "elsewhere"


@dataclass(frozen=True, slots=True)
class TheirMove:
    """`kind` is collect, deploy, wait, or elsewhere for a go-to without an aMussel; `agent_id` is None for the last two."""

    kind: str
    agent_id: int | None = None


@dataclass(frozen=True, slots=True)
class ComparedBelief:
    """Our belief of one aMussel. The errors, believed minus told, are by the first packet after it, None before one."""

    age_s: float
    charge: float
    place_m: Place
    charge_error: float | None = None
    place_error_m: float | None = None
    told_after_s: float | None = None


@dataclass(frozen=True, slots=True)
class ComparedDecision:
    """A decision of theirs, beside ours at the same time. Times are seconds since the first fact."""

    at_s: float
    theirs: TheirMove
    ours: TheirMove
    estimate: ComparedBelief | None
    """Our estimate of the aMussel that they chose."""

    @property
    def agrees(self) -> bool:
        return self.theirs == self.ours


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The errors of estimates older than 10 s against the packet that ended the silence."""

    packets: int
    charge_rms: float | None
    place_rms_m: float | None
    inside: float | None
    """The share of charges within our interval of 95 %; None for an estimator that gives none."""
