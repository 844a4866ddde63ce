"""The strategies that musselbed has: each chooses whom to collect, or in which order the docked ones are released."""
