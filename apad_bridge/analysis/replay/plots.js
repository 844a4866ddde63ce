"use strict";
// Draws plots on canvases. A chart of up to 60 000 points is kept as a picture, over which the time moves.

const STATUSES = ["above", "candidate", "charging", "lost", "unknown"];
const css = getComputedStyle(document.documentElement);
const colour = (name) => css.getPropertyValue("--" + name).trim();
let STATUS_COLOURS, INK, SOFT, LINE, ACCENT, PAINT;
// The colours of the chosen theme.
function readColours() {
  STATUS_COLOURS = STATUSES.map(colour);
  [INK, SOFT, LINE, ACCENT] = ["ink", "soft", "line", "accent"].map(colour);
  PAINT = Object.fromEntries(["card", "water", "shore", "contour", "fence", "grid", "track", "home", "way", "hull", "hull-line",
    "pale", "received", "collided", "half-duplex", "missed"].map((name) => [name, colour(name)]));
}
readColours();
const FONT = "11px system-ui, 'DejaVu Sans', sans-serif";

// A canvas's context, cleared and scaled so that one unit is one CSS pixel.
function fresh(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const ctx = canvas.getContext("2d");
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.clearRect(0, 0, width, height);
  ctx.font = FONT;
  return { ctx, width, height };
}

// 1, 2 or 5 times a power of ten: the smallest that is at least `least`.
function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((m) => m * power >= least * 0.999999);
}

const TIME_UNITS = [[1000, "s"], [60000, "min"], [3600000, "h"], [86400000, "d"]];
function timeTicks(endMs) {
  const [unit, name] = [...TIME_UNITS].reverse().find(([ms]) => endMs >= 2 * ms) || TIME_UNITS[0];
  const step = niceStep(Math.max(endMs, 1) / unit / 6);
  const ticks = [];
  for (let value = 0; value * unit <= endMs; value += step) ticks.push([value * unit, +value.toFixed(3)]);
  ticks[ticks.length - 1][1] += " " + name;
  return ticks;
}

// Draws a picture on a canvas that is drawn anew only when its key or its size changes; returns the canvas's context.
const pictures = new Map();
function picture(canvas, key, draw) {
  const { ctx, width, height } = fresh(canvas);
  let kept = pictures.get(canvas);
  if (!kept || kept.key !== key || kept.own.width !== canvas.width || kept.own.height !== canvas.height) {
    const own = kept ? kept.own : document.createElement("canvas");
    Object.assign(own, { width: canvas.width, height: canvas.height });
    const inner = own.getContext("2d");
    inner.scale(window.devicePixelRatio || 1, window.devicePixelRatio || 1);
    inner.font = FONT;
    draw(inner, width, height);
    kept = { key, own };
    pictures.set(canvas, kept);
  }
  if (kept.own.width && kept.own.height) ctx.drawImage(kept.own, 0, 0, width, height);
  return { ctx, width, height };
}

const boxOf = (width, height) => ({ left: 40, right: width - 10, top: 6, bottom: height - 18 });

// Draws lines over mission time, kept as a picture by `key`. `series` gives [{values, colour, width, step, dash}], or
// [{low, high, colour, alpha}] for a band, drawn in order; null is a gap.
function drawLines(canvas, key, timesMs, nowMs, series, options) {
  const whole = [key, timesMs.length, timesMs[timesMs.length - 1], options.max, document.documentElement.dataset.theme].join();
  const { ctx, width, height } = picture(canvas, whole, (inner, w, h) => drawChart(inner, w, h, timesMs, series(), options));
  drawNow(ctx, boxOf(width, height), nowMs, timesMs[timesMs.length - 1] || 1);
}

function drawNow(ctx, box, nowMs, endMs) {
  const x = box.left + (box.right - box.left) * Math.min(1, nowMs / endMs);
  ctx.lineWidth = 1.5;
  stroke(ctx, INK, [[x, box.top - 4], [x, box.bottom]]);
}

function drawChart(ctx, width, height, timesMs, series, { min, max, format, threshold }) {
  const box = boxOf(width, height);
  const endMs = timesMs[timesMs.length - 1] || 1;
  const x = (ms) => box.left + (box.right - box.left) * ms / endMs;
  const y = (value) => box.bottom - (box.bottom - box.top) * (value - min) / (max - min || 1);
  ctx.lineWidth = 1;
  ctx.textBaseline = "middle";
  ctx.textAlign = "right";
  const step = niceStep((max - min || 1) / Math.max(2, Math.floor((box.bottom - box.top) / 24)));
  for (let value = Math.ceil(min / step) * step; value <= max + step * 1e-6; value += step) {
    stroke(ctx, LINE, [[box.left, y(value)], [box.right, y(value)]]);
    ctx.fillStyle = SOFT;
    ctx.fillText(format(value), box.left - 5, y(value));
  }
  ctx.textAlign = "center";
  for (const [ms, label] of timeTicks(endMs)) {
    ctx.fillStyle = SOFT;
    ctx.fillText(label, Math.min(x(ms), box.right - 8), height - 7);
  }
  if (threshold !== undefined) {
    ctx.setLineDash([5, 4]);
    stroke(ctx, SOFT, [[box.left, y(threshold)], [box.right, y(threshold)]]);
    ctx.setLineDash([]);
  }
  for (const { values, low, high, alpha, colour, width: lineWidth, step: stepped, dash } of series) {
    if (low) { fillBand(ctx, timesMs.map(x), low.map((it) => it === null ? null : y(it)), high.map(y), colour, alpha); continue; }
    ctx.setLineDash(dash || []);
    ctx.strokeStyle = colour;
    ctx.lineWidth = lineWidth;
    ctx.beginPath();
    let before = null;
    values.forEach((value, i) => {
      if (value === null) { before = null; return; }
      if (before === null) ctx.moveTo(x(timesMs[i]), y(value));
      else {
        if (stepped) ctx.lineTo(x(timesMs[i]), y(before));
        ctx.lineTo(x(timesMs[i]), y(value));
      }
      before = value;
    });
    ctx.stroke();
  }
  ctx.setLineDash([]);
}

// Fills the band between two rows of heights; where `low` is null there is a gap.
function fillBand(ctx, xs, low, high, colour, alpha) {
  ctx.fillStyle = colour;
  ctx.globalAlpha = alpha;
  for (let from = 0; from < xs.length; from++) {
    if (low[from] === null) continue;
    let to = from;
    while (to + 1 < xs.length && low[to + 1] !== null) to++;
    ctx.beginPath();
    for (let i = from; i <= to; i++) ctx.lineTo(xs[i], high[i]);
    for (let i = to; i >= from; i--) ctx.lineTo(xs[i], low[i]);
    ctx.fill();
    from = to;
  }
  ctx.globalAlpha = 1;
}

// Draws vertical bars in percent. bars: [{label, value, full, colour}]; `full`, the value at the run's end, is drawn pale.
function drawBars(canvas, bars, marked) {
  const { ctx, width, height } = fresh(canvas);
  const box = boxOf(width, height);
  const y = (percent) => box.bottom - (box.bottom - box.top) * percent / 100;
  ctx.textBaseline = "middle";
  for (const percent of [0, 25, 50, 75, 100]) {
    stroke(ctx, LINE, [[box.left, y(percent)], [box.right, y(percent)]]);
    ctx.fillStyle = SOFT;
    ctx.textAlign = "right";
    ctx.fillText(percent + " %", box.left - 5, y(percent));
  }
  const pitch = (box.right - box.left) / Math.max(1, bars.length);
  const every = Math.ceil(26 / pitch);
  ctx.textAlign = "center";
  bars.forEach(({ label, value, full, colour }, i) => {
    const left = box.left + pitch * (i + 0.15), wide = pitch * 0.7;
    ctx.fillStyle = PAINT.pale;
    ctx.fillRect(left, y(full), wide, box.bottom - y(full));
    ctx.fillStyle = colour;
    ctx.fillRect(left, y(value), wide, box.bottom - y(value));
    if (marked === label) { ctx.strokeStyle = INK; ctx.lineWidth = 1.5; ctx.strokeRect(left, y(full), wide, box.bottom - y(full)); }
    ctx.fillStyle = INK;
    if (i % every === 0) ctx.fillText(label, left + wide / 2, height - 7);
  });
}

function stroke(ctx, style, points) {
  ctx.strokeStyle = style;
  ctx.beginPath();
  points.forEach(([px, py], i) => (i ? ctx.lineTo(px, py) : ctx.moveTo(px, py)));
  ctx.stroke();
}
