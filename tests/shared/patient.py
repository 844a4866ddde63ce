"""How long tests wait for processes: a time-out is only ever waited out by a failure, and a busy machine is none."""

from __future__ import annotations

import sys

PATIENCE_S = 180.0
PATIENT_MUSSELBED = [
    sys.executable,
    "-c",
    f"from apad_bridge.runs import parent; parent._END_S = {PATIENCE_S}; "
    "from apad_bridge.commands.main import main; raise SystemExit(main())",
]
"""`musselbed`, whose parent does not kill a supervisor that ends in order, but waits for a processor meanwhile."""
