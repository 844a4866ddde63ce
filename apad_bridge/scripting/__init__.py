from pathlib import Path

PROVE_STOP = Path(__file__).with_name("prove_stop.py")
"""The script by which a preflight proves a stop."""
STOP_PROVEN = "stop_proven"
"""The event that this script notes once the aPad has come to rest."""
