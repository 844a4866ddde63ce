"""The firmware of the aMussel's MU (Measurement Unit) board: standard library only, no clock, no I/O, no randomness.

Every part has the same three verbs, and nothing else drives it:

    next_due_ms                         the time of the part's next timer, or None
    advance(now_ms) -> list[Action]     let time pass; every timer fires at its own due time, in order
    receive(stimulus, now_ms)           a fact from outside; advances first
"""
