from firmware_model.sampling.sensor import Sensor

# Practical salinity from a cell of conductivity at the temperature beside it, in steps of 0.001. Coefficients, noise, load
# and the bay's value are assumed: take those of your cell.
SALINITY = Sensor(
    "salinity",
    "psu",
    coefficients=(-1.0, 0.001),
    low=0.0,
    high=42.0,
    noise=0.02,
    calm=33.0,
    load_mw=60,
    load_source="assumed: a cell of conductivity of this class",
)
