"""Debian's Chromium, driven by a test."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from patient import PATIENCE_S
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.wait import WebDriverWait

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--force-device-scale-factor=1",
    "--window-size=1400,1200",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)
"""Without a network but the loopback."""


@contextmanager
def chromium() -> Iterator[webdriver.Chrome]:
    """A browser that keeps its console's lines; it ends with the context."""
    options = webdriver.ChromeOptions()
    for flag in FLAGS:
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


def text(browser: webdriver.Chrome, element: str) -> str:
    """The text of the element of this id, shown or not, with single spaces."""
    found = "return document.getElementById(arguments[0]).textContent.replace(/\\s+/g, ' ').trim()"
    return str(browser.execute_script(found, element))


def cells(browser: webdriver.Chrome, rows: str) -> list[list[str]]:
    """The texts of what stands in each of the rows that a selector finds."""
    found = """
      return [...document.querySelectorAll(arguments[0])].map((it) => [...it.children].map((one) => one.textContent));
    """
    return list(browser.execute_script(found, rows))


def errors(browser: webdriver.Chrome) -> list[Any]:
    return [it for it in browser.get_log("browser") if it["level"] == "SEVERE"]  # type: ignore[no-untyped-call]


def screen(browser: webdriver.Chrome, width: int, height: int = 900, scale: int = 1) -> None:
    """The size of the screen in CSS pixels; a narrow one is a phone's."""
    size = {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def scheme(browser: webdriver.Chrome, name: str, media: str = "screen") -> None:
    """The colours that the system asks for: `light` or `dark`."""
    feature = {"name": "prefers-color-scheme", "value": name}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": media, "features": [feature]})


LEAST_CONTRAST = 4.5
"""WCAG 2.1, 1.4.3, of text that is not large."""
_LOW_CONTRAST = """
  const parts = (colour) => {
    const [r, g, b, a] = colour.match(/[\\d.]+/g).map(Number), most = colour.startsWith("color(") ? 255 : 1;
    return [r * most, g * most, b * most, a ?? 1];
  };
  const over = ([r, g, b, a], under) => [r, g, b].map((it, n) => it * a + under[n] * (1 - a));
  const light = (rgb) => rgb.map((it) => it / 255).map((it) => (it <= 0.03928 ? it / 12.92 : ((it + 0.055) / 1.055) ** 2.4))
    .reduce((sum, it, n) => sum + it * [0.2126, 0.7152, 0.0722][n], 0);
  const chain = (it) => (it ? [...chain(it.parentElement), it] : []);
  const found = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.textContent.trim(), element = walker.currentNode.parentElement;
    if (!text || !element.checkVisibility() || element.closest("script, style, :disabled, option, svg")) continue;
    let under = [255, 255, 255], opacity = 1;
    for (const it of chain(element)) {
      const style = getComputedStyle(it);
      under = over(parts(style.backgroundColor), under);
      opacity *= Number(style.opacity);
    }
    const [r, g, b, a] = parts(getComputedStyle(element).color), ink = over([r, g, b, a * opacity], under);
    const [high, low] = [light(ink), light(under)].sort((one, other) => other - one), ratio = (high + 0.05) / (low + 0.05);
    if (ratio < arguments[0]) found.push(`${ratio.toFixed(2)} ${element.id || element.className}: ${text.slice(0, 40)}`);
  }
  return [...new Set(found)];
"""


def low_contrast(browser: webdriver.Chrome) -> list[str]:
    """The visible texts, in light and in dark colours, that stand out too little from what lies below them."""
    found: list[str] = []
    for name in ("light", "dark"):
        scheme(browser, name)
        found += browser.execute_script(_LOW_CONTRAST, LEAST_CONTRAST)
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    return found
