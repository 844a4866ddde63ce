"""Debian's Chromium, driven by a test."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from patient import PATIENCE_S
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.wait import WebDriverWait


@contextmanager
def chromium(flags: Iterable[str]) -> Iterator[webdriver.Chrome]:
    """A browser that keeps its console's lines; it ends with the context."""
    options = webdriver.ChromeOptions()
    for flag in flags:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
    try:
        yield driver
    finally:
        driver.quit()


def load_page(browser: webdriver.Chrome, address: str) -> None:
    """Loads a page as a new tab does, and waits for its scripts: on a busy machine `get` may return between two of them."""
    browser.get("about:blank")  # of an address that changes after its # alone, nothing is loaded anew
    browser.get(address)
    loaded = "return location.href !== 'about:blank' && document.readyState === 'complete'"
    WebDriverWait(browser, PATIENCE_S, 0.05).until(lambda it: it.execute_script(loaded))
