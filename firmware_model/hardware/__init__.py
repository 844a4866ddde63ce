"""The hardware of an MU board: batteries, rails, charger and clock. Firmware sees `firmware_model.port` of it, no more."""
