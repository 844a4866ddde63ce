"""The life of a board on its bench, told in the words of a conformance script."""

from firmware_model.bench import Bench
from firmware_model.bench.rigs import BenchRig
from firmware_model.packets import Kind


class RigOfAnyId(BenchRig):
    """Its board need not be aMussel 1, as that of a case is."""

    def command(self, kind: Kind) -> None:
        self.bench.command(kind)


def lives(bench: Bench, script: str) -> None:
    """Plays waits, commands, edges of the charger's pin and resets, such as `permission 2min rises 500ms`."""
    for word in script.split():
        RigOfAnyId(bench).play(word)
