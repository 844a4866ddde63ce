"""The bytes of a log: sensors, noise, flash and packets of two hundred samples, as the first version made them."""

from __future__ import annotations

from hashlib import sha256

from agents.mussel.logbook import Logbook
from agents.mussel.sensor_bus import SensorBus
from agents.water.fields import Constant, WaterFields, unit_noises
from firmware_model.sampling.flash import MemoryFlash

HOUR_MS = 3_600_000


def test_the_noise_of_a_sample_is_what_it_was() -> None:
    assert unit_noises(7, 3, 9) == (
        -1.2859484764883065,
        0.9162413263180115,
        -0.820801078836856,
        0.46511002140415003,
    )


def place_um(now_ms: int) -> tuple[int, int, int]:
    n = now_ms // HOUR_MS
    return 1000 * n, -500 * n, 40_000 * n


def test_flash_and_upload_are_byte_for_byte_what_they_were() -> None:
    fields = WaterFields.by_key(
        {"oxygen_mg_l": Constant(6.0), "temperature_c": Constant(21.5), "turbidity_ntu": Constant(2000.0)}
    )
    flash = MemoryFlash()
    sensors = SensorBus(3, 7, fields, place_um)
    book = Logbook(3, sensors, flash, 0, 0)
    for n in range(200):
        book.take_sample(HOUR_MS * n, HOUR_MS * n + 7)
    pages = b"".join(flash.read(page * flash.page_bytes, flash.page_bytes) for page in range(flash.pages))
    uploaded = b"".join(packet.encode() for packet in book.begin_upload())
    assert sha256(pages).hexdigest() == "f20e9788457c226c467e8d776a1472068a7b16e0c84e9686174abfb805197ec9"
    assert sha256(uploaded).hexdigest() == "559591bb29755dfea98257342c6384e0b49682840618f21396f4891e5886085a"
