from pathlib import Path

PROVE_STOP = Path(__file__).with_name("prove_stop.py")
"""The script by which a preflight proves a stop."""
