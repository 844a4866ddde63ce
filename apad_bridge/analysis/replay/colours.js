"use strict";
// The page's colours by name, in the theme that is chosen. `series.py` decides the status that each aMussel is drawn in.

const STATUSES = ["above", "candidate", "charging", "lost", "unknown", "empty"];
const css = getComputedStyle(document.documentElement);
const colour = (name) => css.getPropertyValue("--" + name).trim();
let STATUS_COLOURS, INK, SOFT, LINE, ACCENT, PAINT;
// The colours of the chosen theme.
function readColours() {
  STATUS_COLOURS = STATUSES.map(colour);
  [INK, SOFT, LINE, ACCENT] = ["ink", "soft", "line", "accent"].map(colour);
  PAINT = Object.fromEntries(["card", "bad", "water", "shore", "contour", "fence", "grid", "track", "home", "way", "hull", "hull-line",
    "pale", "received", "collided", "half-duplex", "missed"].map((name) => [name, colour(name)]));
}
readColours();
const DARK = matchMedia("(prefers-color-scheme: dark)");
const themeNow = () => document.documentElement.dataset.theme || (DARK.matches ? "dark" : "light");
DARK.addEventListener("change", () => { readColours(); show(nowMs); });
