"""Debian's Chromium, driven by a test."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from selenium import webdriver
from selenium.webdriver.chrome.service import Service


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
