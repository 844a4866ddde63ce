"""What runs on the aMussel's MU (Measurement Unit) board: standard library only, no clock, no I/O, no randomness.

Every part has the same three verbs and nothing else moves it:

    next_due_ms                         when the part next has something to do by itself, or None
    advance(now_ms) -> list[Action]     let time pass; every timer fires at its own due time, in order
    receive(stimulus, now_ms)           a fact from outside; advances first
"""
