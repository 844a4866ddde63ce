"""What others took of the machine, for promises in seconds."""

from pathlib import Path


def stalled_s() -> float:
    """Wall seconds so far in which some process waited for a processor or a disk; 0 where no kernel counts."""
    files = [Path("/proc/pressure/cpu"), Path("/proc/pressure/io")]
    totals = [int(it.read_text().split("total=")[1].split()[0]) for it in files if it.exists()]
    return sum(totals) / 1e6
