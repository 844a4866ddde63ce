// Charts over mission time by uPlot, with one zoom and a mark of the time shown; pictures and bars on canvases of our own.

const ROW_NAMES = 124;
const FONT = "11px system-ui, 'DejaVu Sans', sans-serif";

// The sizes of elements, so that a frame need not ask the page's layout for them.
const sizes = new Map();
const resized = new ResizeObserver((entries) => {
  const changed = entries.filter(({ target }) => {
    const known = sizes.get(target);
    return known && (known.width !== target.clientWidth || known.height !== target.clientHeight);
  });
  if (!changed.length) return;
  for (const { target } of changed) sizes.delete(target);
  show(nowMs);
});
function sizeOf(element) {
  let size = sizes.get(element);
  if (!size || !size.width) {
    size = { width: element.clientWidth, height: element.clientHeight };
    sizes.set(element, size);
    resized.observe(element);
  }
  return size;
}

// A canvas's context, cleared and scaled so that one unit is one CSS pixel.
function fresh(canvas) {
  const ratio = window.devicePixelRatio || 1, { width, height } = sizeOf(canvas);
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

// Black or white, which is read better on the colour that a context fills with: 4.5 to 1 or more on any.
function inkOn(ctx) {
  const [red, green, blue] = [1, 3, 5].map((at) => parseInt(ctx.fillStyle.slice(at, at + 2), 16) / 255)
    .map((it) => (it <= 0.03928 ? it / 12.92 : ((it + 0.055) / 1.055) ** 2.4));
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.179 ? "#000" : "#fff";
}

// A picture of a canvas's size, drawn anew only when its key or that size changes.
const pictures = new Map();
function picture(canvas, key, draw) {
  let kept = pictures.get(canvas);
  if (!kept || kept.key !== key || kept.own.width !== canvas.width || kept.own.height !== canvas.height) {
    const own = kept ? kept.own : document.createElement("canvas"), ratio = window.devicePixelRatio || 1;
    Object.assign(own, { width: canvas.width, height: canvas.height });
    const inner = own.getContext("2d");
    inner.scale(ratio, ratio);
    inner.font = FONT;
    draw(inner);
    kept = { key, own };
    pictures.set(canvas, kept);
  }
  return kept.own;
}

// 1, 2 or 5 times a power of ten: the smallest that is at least `least`.
function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((m) => m * power >= least * 0.999999);
}

const [SECOND, MINUTE, HOUR, DAY] = [1000, 60000, 3600000, 86400000];
const TIME_STEPS = [[1, 2, 5, 10, 20, 30], [1, 2, 5, 10, 20, 30], [1, 2, 3, 6, 12], [1, 2, 5, 10, 20, 50, 100]]
  .flatMap((steps, n) => steps.map((it) => it * [SECOND, MINUTE, HOUR, DAY][n]));
function timeLabels(plot, times, axis, space, step) {
  const unit = [[DAY, " d"], [HOUR, " h"], [MINUTE, " min"]].find(([ms]) => step >= ms);
  return times.map((ms) => (unit ? +(ms / unit[0]).toFixed(3) + unit[1] : clock(ms)));
}

// The charts by their elements' ids, and the span of mission time that all of them show; null: the whole run.
const charts = new Map();
let zoom = null;
const LEAST_ZOOM = 10 * SECOND;

function zoomTo(span) {
  zoom = null;
  if (span) {
    const wide = Math.min(endMs, Math.max(LEAST_ZOOM, span[1] - span[0])), from = Math.max(0, Math.min(endMs - wide, span[0]));
    if (wide < 0.999 * endMs) zoom = [from, from + wide];
  }
  $("whole").hidden = zoom === null;
  for (const chart of charts.values()) fit(chart.plot);
}

// Shows `factor` times as long a span, around the time shown.
function zoomBy(factor) {
  const [from, to] = zoom || [0, endMs], half = (to - from) * factor / 2;
  zoomTo([nowMs - half, nowMs + half]);
}

function fit(plot) {
  plot.setScale("x", { min: zoom ? zoom[0] : 0, max: zoom ? zoom[1] : endMs || 1 });
}

// Draws a chart. `shape` names what it has, `key` its values: it is built anew or filled anew only when these change.
// `of` gives {lines: [{times, values, stroke, width, dash, step}], min, max, format, rows, under, over}; null is a gap. The
// values on the left are those of `format`, or the names in `rows`; one that stands above rows has their times below each other
// (`isAboveRows`). `under` and `over` draw below and above the lines.
function drawChart(id, shape, key, of) {
  const element = $(id), size = sizeOf(element), whole = [key, endMs, themeNow()].join();
  let chart = charts.get(id);
  if (!size.width) return;
  if (chart && chart.shape === shape && chart.whole === whole && chart.size === size) return;
  const content = of();
  if (!chart || chart.shape !== shape) {
    if (chart) chart.plot.destroy();
    chart = { shape, content };
    charts.set(id, chart);
    chart.plot = new uPlot(chartOptions(chart, size), valuesOf(content.lines), element);
    chart.mark = Object.assign(document.createElement("div"), { className: "mark" });
    chart.plot.over.append(chart.mark);
    chart.plot.over.addEventListener("click", () => { leaveEnd(); show(chart.plot.posToVal(chart.plot.cursor.left, "x")); writeAddress(); });
  } else {
    chart.content = content;
    if (chart.size !== size) chart.plot.setSize(size);
    chart.plot.setData(valuesOf(content.lines), false);
  }
  Object.assign(chart, { whole, size });
  fit(chart.plot);
}

// Shows a chart's lines with other widths and colours, without new values.
function restyle(id) {
  const chart = charts.get(id);
  if (!chart) return;
  chart.plot.series.forEach((it, n) => { if (n) it.width = chart.content.lines[n - 1].width(); });
  chart.plot.redraw(false);
}

const call = (value) => (typeof value === "function" ? value() : value);

// Lines of one run share their times; those of several are put on the times of all.
function valuesOf(lines) {
  if (!lines.length) return [[0], [null]];
  const { times } = lines[0];
  if (lines.every((it) => it.times === times)) return [times, ...lines.map((it) => it.values)];
  return uPlot.join(lines.map((it) => [it.times, it.values]));
}

function chartOptions(chart, { width, height }) {
  const axis = { font: FONT, stroke: () => SOFT, ticks: { show: false } };
  const rows = () => chart.content.rows;
  const left = chart.content.rows
    ? { grid: { show: false }, size: ROW_NAMES, splits: () => rows().map((_, n) => n + 0.5), values: () => rows() }
    : { grid: { stroke: () => LINE, width: 1 }, size: chart.content.isAboveRows ? ROW_NAMES : 44, space: 24, values: (plot, splits) => splits.map((it) => chart.content.format(it)) };
  const lines = chart.content.lines.length ? chart.content.lines : [{ width: 0, stroke: LINE }];
  return {
    width, height, padding: [6, 28, 0, 0], legend: { show: false },
    cursor: { y: false, points: { show: false }, drag: { setScale: false }, bind: { dblclick: () => () => zoomTo(null) } },
    scales: { x: { time: false, range: (plot, from, to) => [from, to] }, y: { range: () => [chart.content.min, chart.content.max] } },
    axes: [{ ...axis, grid: { show: false }, size: 26, gap: 8, space: 64, incrs: TIME_STEPS, values: timeLabels }, { ...axis, ...left }],
    series: [{}, ...lines.map((line, n) => ({
      stroke: (plot) => { const now = chart.content.lines[n] || line; return typeof now.stroke === "function" ? now.stroke(plot) : now.stroke; },
      width: call(line.width), dash: line.dash, points: { show: false },
      ...(line.step ? { paths: uPlot.paths.stepped({ align: 1 }) } : {}),
    }))],
    hooks: {
      drawClear: [(plot) => inside(plot, drawInterruptions), (plot) => inside(plot, chart.content.under)],
      draw: [(plot) => inside(plot, chart.content.over)],
      setCursor: [(plot) => hoverChart(chart, plot)],
      setScale: [(plot, name) => { if (name === "x" && chart.mark) moveMark(chart); }],
      setSelect: [(plot) => {
        if (!plot.select.width) return;
        const span = [plot.select.left, plot.select.left + plot.select.width].map((it) => plot.posToVal(it, "x"));
        plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        zoomTo(span);
      }],
    },
  };
}

// Below everything: the times in which the mission was kept from the aPad.
function drawInterruptions(ctx, x) {
  ctx.globalAlpha = 0.16;
  ctx.fillStyle = PAINT.way;
  for (const [from, to] of interruptedSpans(data)) ctx.fillRect(x(from), 0, Math.max(1, x(to) - x(from)), ctx.canvas.height);
  ctx.globalAlpha = 1;
}

// Draws within a chart's frame; `x` and `y` of a value are in pixels of its canvas, `pixel` is one of the page.
function inside(plot, draw) {
  if (!draw) return;
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  draw(ctx, (ms) => plot.valToPos(ms, "x", true), (value) => plot.valToPos(value, "y", true), uPlot.pxRatio);
  ctx.restore();
}

// Moves each chart's mark to the time shown: elements over the canvases, so that a frame draws no chart.
function moveMarks() {
  for (const chart of charts.values()) moveMark(chart);
}

function moveMark({ plot, mark }) {
  const { min, max } = plot.scales.x;
  mark.style.transform = `translateX(${((nowMs - min) / (max - min || 1) * plot.bbox.width / uPlot.pxRatio).toFixed(1)}px)`;
}

// A line's colours over time as a gradient with sharp ends: `of` gives the colour's number at each time.
function timeColours(plot, times, of, colours) {
  const { min, max } = plot.scales.x, { left, width } = plot.bbox;
  const gradient = plot.ctx.createLinearGradient(left, 0, left + width, 0);
  let before = null;
  times.forEach((ms, i) => {
    if (of[i] === before) return;
    const at = Math.max(0, Math.min(1, (ms - min) / (max - min || 1)));
    if (before !== null) gradient.addColorStop(at, colours[before]);
    gradient.addColorStop(before === null ? 0 : at, colours[of[i]]);
    before = of[i];
  });
  return gradient;
}

// Fills the band between two rows of heights; where `low` is null there is a gap.
function fillBand(ctx, xs, low, high, style, alpha) {
  ctx.fillStyle = style;
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

// The words beside the pointer: a value with its id, of whatever lies under it.
function hover(text, at) {
  const box = $("hover");
  if (box.hidden !== !text) box.hidden = !text;
  if (!text) return;
  put(box, text);
  box.style.left = Math.max(4, Math.min(at.x + 14, innerWidth - box.offsetWidth - 8)) + "px";
  box.style.top = (at.y + 18 + box.offsetHeight > innerHeight ? at.y - box.offsetHeight - 10 : at.y + 18) + "px";
}

// Of a chart's lines the one that is nearest to the pointer; of rows, the one that it is in.
function hoverChart({ content }, plot) {
  const { left, top, idx } = plot.cursor;
  if (left === undefined || left < 0 || idx === null || idx === undefined) { hover(""); return; }
  const ms = plot.data[0][idx], box = plot.over.getBoundingClientRect(), at = { x: box.left + left, y: box.top + top };
  if (content.rows) {
    const row = content.rows[content.rows.length - 1 - Math.floor(content.rows.length * top / box.height)];
    hover(row && `${clock(ms)}  ${row}${content.wordsAt ? content.wordsAt(row, plot.posToVal(left, "x")) : ""}`, at);
    return;
  }
  let nearest = null, least = Infinity;
  content.lines.forEach((line, n) => {
    const value = plot.data[n + 1] && plot.data[n + 1][idx];
    if (value === null || value === undefined) return;
    const away = Math.abs(plot.valToPos(value, "y") - top);
    if (away < least) [nearest, least] = [`${clock(ms)}  ${line.name ? line.name + ": " : ""}${(content.exact || content.format)(value)}`, away];
  });
  hover(nearest, at);
}

// Shows the words of what lies under the pointer on a canvas of our own; `of` gives them for a place in CSS pixels.
function hoverCanvas(id, of) {
  $(id).addEventListener("pointermove", (event) => hover(of(event.offsetX, event.offsetY), { x: event.clientX, y: event.clientY }));
  $(id).addEventListener("pointerleave", () => hover(""));
}

// Draws vertical bars in percent. bars: [{label, value, full, colour}]; `full`, the value at the run's end, is drawn pale.
function drawBars(canvas, bars, marked) {
  const { ctx, width, height } = fresh(canvas);
  const box = { left: 44, right: width - 28, top: 6, bottom: height - 18 };
  const y = (percent) => box.bottom - (box.bottom - box.top) * percent / 100;
  ctx.textBaseline = "middle";
  for (const percent of [0, 25, 50, 75, 100]) {
    stroke(ctx, LINE, [[box.left, y(percent)], [box.right, y(percent)]]);
    ctx.fillStyle = SOFT;
    ctx.textAlign = "right";
    ctx.fillText(percent + " %", box.left - 5, y(percent));
  }
  const pitch = (box.right - box.left) / Math.max(1, bars.length);
  drawnBars = { bars, left: box.left, pitch };
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

let drawnBars = { bars: [], left: 0, pitch: 1 };
function barWords(x) {
  const bar = drawnBars.bars[Math.floor((x - drawnBars.left) / drawnBars.pitch)];
  return x >= drawnBars.left && bar ? `aMussel ${bar.label}: ${bar.value.toFixed(1)} % so far, ${bar.full.toFixed(1)} % at the end` : "";
}

function stroke(ctx, style, points) {
  ctx.strokeStyle = style;
  ctx.beginPath();
  points.forEach(([px, py], i) => (i ? ctx.lineTo(px, py) : ctx.moveTo(px, py)));
  ctx.stroke();
}
