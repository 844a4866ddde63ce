"""A report as a browser prints it: A4 portrait, nothing beyond the page's edges, every figure drawn."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path

import numpy as np
import pytest
from browsers import load_page, low_contrast, scheme, screen
from PIL import Image
from programs import code_here
from scenario_files import write_scenario
from selenium import webdriver
from selenium.webdriver.common.by import By

pytestmark = pytest.mark.system
MM = 96 / 25.4
"""CSS pixels in a millimetre."""
PAGE_MM, MARGIN_MM = (210, 297), 14


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three runs of ten minutes side by side, one with a name that is too long for a column."""
    folder = tmp_path_factory.mktemp("report")
    names = ("first", "second", "a-run-with-a-name-that-is-much-longer-than-its-column")
    runs = [folder / name for name in names]
    scenario = write_scenario(folder / "short.yaml", duration_s=600, fleet={"hosting": "one_process"})
    for run in runs:
        assert code_here("run", scenario, "--time", "asap", "--out", run, "--json") == 0
    assert code_here("report", *runs, "--out", folder / "out", "--data", "none") == 0
    return folder / "out" / "report.html"


BEYOND = """
  const width = document.documentElement.clientWidth + 0.5;
  const isCut = (it) => it.scrollWidth > it.clientWidth + 1 && getComputedStyle(it).display !== "inline";
  return [...document.querySelectorAll("body *")].filter((it) => it.getBoundingClientRect().right > width || isCut(it))
    .map((it) => it.outerHTML.slice(0, 80));
"""


def test_every_printed_page_is_a4_and_nothing_is_cut(page: Path, browser: webdriver.Chrome) -> None:
    load_page(browser, page.as_uri())
    printed = browser.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True, "printBackground": True})
    pdf = base64.b64decode(printed["data"])
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf)
    sizes_mm = {tuple(round(float(it) * 25.4 / 72) for it in box) for box in boxes}
    assert sizes_mm == {PAGE_MM} and 4 <= len(boxes) <= 20
    # The same layout on a screen of the printed width: nothing is beyond it, and no table is wider than its column.
    scheme(browser, "light", "print")
    screen(browser, round((PAGE_MM[0] - 2 * MARGIN_MM) * MM))
    assert browser.execute_script(BEYOND) == []
    drawn = "return [...document.images].map((it) => it.complete && it.naturalWidth > 300)"
    assert (found := browser.execute_script(drawn)) and all(found)


def test_on_a_phone_every_text_stands_out_and_a_wide_table_scrolls_by_itself(
    page: Path, browser: webdriver.Chrome
) -> None:
    screen(browser, 390)
    load_page(browser, page.as_uri())
    assert low_contrast(browser) == []
    assert browser.execute_script("return document.documentElement.scrollWidth") == 390
    # So does a figure, whose least text of 8 points on a drawing 7.1 inches wide is then no smaller than 10 pixels.
    widths = browser.execute_script("return [...document.images].map((it) => it.clientWidth)")
    assert widths and all(it / 7.1 * 8 / 72 >= 10 for it in widths)


def test_drawings_are_dark_on_a_dark_screen_and_white_on_paper(page: Path, browser: webdriver.Chrome) -> None:
    screen(browser, 1400)
    for media, name, is_dark in (
        ("screen", "light", False),
        ("screen", "dark", True),
        ("print", "dark", False),
    ):
        scheme(browser, name, media)
        load_page(browser, page.as_uri())
        drawing = Image.open(io.BytesIO(browser.find_element(By.TAG_NAME, "img").screenshot_as_png))
        white = np.asarray(drawing.convert("L"))[3, 3]
        assert white < 64 if is_dark else white > 240
