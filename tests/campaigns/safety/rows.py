"""All rows of the campaign, in the order of the table."""

from safety import command, disobedience, faults_at_sea, latches, late_vehicles, several
from safety.row import Row

ROWS: dict[str, Row] = (
    faults_at_sea.ROWS | late_vehicles.ROWS | disobedience.ROWS | command.ROWS | latches.ROWS | several.ROWS
)

_SPOILED = {
    "tether",
    "resumed, guard's hold",
    "resumed, not taken",
    "stop and hands, busy",
    *disobedience.ROWS,
}
_SPOILED |= {name for name in late_vehicles.ROWS if name.startswith("answers")}
COUNTERPARTS = {
    name
    for name, row in ROWS.items()
    if "b" in row.generations and row.setup.apads == 1 and not row.setup.is_our_own and name not in _SPOILED
}
"""Rows of one vehicle of generation B whose hull and services have no fault of ours."""
