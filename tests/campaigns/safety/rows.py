"""All rows of the campaign, in the order of the table."""

from safety import command, disobedience, faults_at_sea, latches, late_vehicles, several
from safety.row import Row

ROWS: dict[str, Row] = (
    faults_at_sea.ROWS | late_vehicles.ROWS | disobedience.ROWS | command.ROWS | latches.ROWS | several.ROWS
)
