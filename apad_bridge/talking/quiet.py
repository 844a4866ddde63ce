"""When an aPad may speak: outside of the aMussels' timeslots. Agent time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Quiet:
    """The first `taken_ms` of each frame are the aMussels'; a frame that is all theirs leaves no choice."""

    frame_ms: int
    taken_ms: int

    def first_ms(self, now_ms: int, lasting_ms: int) -> int:
        """The first time from now on from which it is quiet for so long.

        What lasts longer than any quiet begins with one; where there is none, it begins now.
        """
        if self.taken_ms >= self.frame_ms or self.taken_ms <= 0:
            return now_ms
        into_ms = now_ms % self.frame_ms
        if into_ms < self.taken_ms:
            return now_ms + self.taken_ms - into_ms
        if into_ms + lasting_ms <= self.frame_ms or into_ms == self.taken_ms:
            return now_ms
        return now_ms + self.frame_ms - into_ms + self.taken_ms


ALWAYS = Quiet(1, 0)
"""Nobody has timeslots."""
