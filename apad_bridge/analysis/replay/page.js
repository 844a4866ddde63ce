// Shows a run at one mission time. The address holds what is shown: #t=SECONDS, and where chosen &aMussel=ID, &aPad=NAME (of
// two compared runs &run=NAME), &zoom=FROM-TO in seconds, &why=1 (the reasons of a plan), &events=KINDS and &theme=contrast.
// So an address that is sent to somebody shows the same moment there.

const runs = JSON.parse(document.getElementById("data").textContent);
let data = runs[0];
const $ = (id) => document.getElementById(id);
const MOST_EVENTS = 1000;
const MOST_PACKETS = 40;
const SPEEDS = [1, 5, 20, 60, 300, 1200, 7200, 43200];
const PART_MS = 60;
// The categories of events that each choice lists; all of them without a choice.
const CATEGORIES = { notes: ["word"], plans: ["plan"], failures: ["alarm", "trouble", "relief"] };
const CHOSEN_BY = runs[0].differs ? "run" : "aPad";
let partMs = 0, part = 0;
let endMs = 0, nowMs = 0, playing = null, pointed = null, selected = null;
const marked = () => (pointed === null ? selected : pointed);

const percent = (value) => (100 * value).toFixed(1) + " %";

function clock(ms) {
  const s = Math.floor(ms / 1000), pad = (n) => String(n).padStart(2, "0");
  const days = Math.floor(s / 86400);
  return (days ? days + " d " : "") + pad(Math.floor(s / 3600) % 24) + ":" + pad(Math.floor(s / 60) % 60) + ":" + pad(s % 60);
}

// What follows the time shown. While it plays, each frame draws the map and moves the clocks and the charts' marks, and one of
// these parts takes its turn.
const PARTS = [
  showStop,
  showWords,
  showNow,
  showAgents,
  showEventNow,
  showWhy,
  showPackets,
  showSlots,
  (view) => drawBars($("uptime"), data.agents.map((agent, n) => ({ label: agent.id, value: agent.uptime[view.i], full: agent.uptime[agent.uptime.length - 1], colour: STATUS_COLOURS[view.agents[n].status] })), marked()),
  showSelected,
  showMeasured,
  (view, views) => showDifferences(views),
];

function show(ms) {
  nowMs = Math.max(0, Math.min(endMs, ms));
  const views = runs.map((it) => viewAt(nowMs, it)), view = views[runs.indexOf(data)];
  $("scrub").value = nowMs / 1000;
  put($("mission-clock"), clock(nowMs));
  put($("agent-clock"), clock(nowMs * data.theta));
  document.body.dataset.timeMs = Math.round(nowMs);
  if (!playing) for (const it of PARTS) it(view, views);
  else if (performance.now() - partMs > PART_MS) {
    partMs = performance.now();
    PARTS[part++ % PARTS.length](view, views);
  }
  drawMaps(views);
  drawCharts();
  moveMarks();
}

function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// One map has all aPads of a flight, the chosen one last; two compared runs have a map each.
function drawMaps(views) {
  const packets = packetsAround();
  if (runs[0].differs) {
    runs.forEach((run, n) => drawMap($(n ? "other-map" : "map"), [run], [views[n]], marked(), packets.filter((it) => it.run === run)));
    return;
  }
  const order = [...runs.keys()].sort((a, b) => (runs[a] === data) - (runs[b] === data));
  drawMap($("map"), order.map((n) => runs[n]), order.map((n) => views[n]), marked(), packets);
}

// The last order of a mission is to hold.
function doingWords({ stop, primitive, phase }) {
  const idle = stop ? "stopped" : phase === "ended" ? "the last order was to hold the position" : "no order under way";
  return stop && stop.mode === "off" ? "no thrust" : primitive || idle;
}

function showWords({ stage, docks, agents, active, cost, apad }) {
  put($("phase"), stage.phase || "waiting");
  put($("primitive"), doingWords(stage));
  put($("docks"), docks.map((id) => (id === null ? "free" : id)).join(" · "));
  if (shownStage !== stage) { shownStage = stage; $("plan").replaceChildren(...planWords(stage.plan)); }
  const charges = agents.map((it) => it.charge).filter((it) => it !== null);
  const mean = (list) => list.reduce((a, b) => a + b, 0) / list.length;
  const one = agents.find((it) => it.id === marked());
  put($("charge-now"), one ? chargeWords(one) : charges.length ? `mean ${percent(mean(charges))}, least ${percent(Math.min(...charges))}` : "unknown");
  put($("uptime-now"), data.has_truth ? `mean ${mean(agents.map((it) => it.uptime)).toFixed(1)} %` : "no truth was recorded");
  put($("active-now"), data.has_truth ? `${active} of ${agents.length}` : "no truth was recorded");
  put($("cost-now"), cost.toFixed(0) + " m");
  put($("apad-now"), apad && apad.battery !== null ? percent(apad.battery) : "unknown");
}
let shownStage;

// For a first look: what the aPad does, whether all is well, and how long it can go on.
function showNow({ stage, agents, apad }) {
  const count = (what, is) => [agents.filter(is).length, what];
  const found = [...["empty", "lost"].map((what) => count(what, (it) => STATUSES[it.status] === what)), count("suspect", (it) => it.suspicion)];
  const faults = found.filter(([many]) => many).map(([many, what]) => `${many} ${what}`);
  const well = [faults.length ? `aMussels: ${faults.join(", ")}` : "no aMussel empty, lost or suspect"];
  const battery = apad && apad.battery !== null ? [`aPad ${percent(apad.battery)}`] : [];
  put($("now"), [doingWords(stage), ...well, ...battery].join(" · "));
  if ($("now").classList.contains("ill") !== faults.length > 0) $("now").classList.toggle("ill");
}

function chargeWords({ id, charge, believed, within }) {
  const words = [`${id}: ${charge === null ? "unknown" : percent(charge)}`];
  if (believed !== null) words.push(", believed " + percent(believed));
  if (within) words.push(` (${within.map((it) => (100 * it).toFixed(1)).join(" to ")})`);
  return words.join("");
}

function planWords(plan) {
  if (!plan) return ["none yet"];
  const head = document.createElement("span");
  head.textContent = `${plan.what} (${plan.strategy}):`;
  return [head, ...plan.steps.map(([id], n) => {
    const step = document.createElement("span");
    step.textContent = id;
    step.className = n < plan.done ? "done" : n === plan.done ? "now" : "";
    return step;
  })];
}

// The time since its newest packet. What is believed of it ages as long; the supervisor suspects one that is silent too long.
const ago = ({ heard }) => `${clock(Math.max(0, nowMs - 1000 * heard))} ago`;
const suspectWords = ({ suspicion }) => (suspicion ? [`suspect since ${clock(suspicion[0])}: ${suspicion[2]}`] : []);
// What its twin has learned of its batteries' age, in whole percent.
const ageWords = ({ capacity }) => (capacity ? [`${capacity.map((it) => Math.round(100 * it)).join(" to ")} % of its capacity left`] : []);
const isSilent = ({ heard, dock }) => heard !== null && dock === null && nowMs - 1000 * heard > 1000 * data.silence_s;

function showAgents({ agents }) {
  agents.forEach((agent, n) => {
    const item = $("agents").children[n];
    const words = agent.charge === null ? "?" : (100 * agent.charge).toFixed(0) + " %";
    if (item.dataset.status !== STATUSES[agent.status]) item.dataset.status = STATUSES[agent.status];
    if (item.lastChild.textContent !== words) item.lastChild.textContent = words;
    item.classList.toggle("marked", marked() === agent.id);
    item.classList.toggle("selected", selected === agent.id);
    item.classList.toggle("silent", isSilent(agent));
    item.classList.toggle("suspect", agent.suspicion !== null);
    const title = [agent.heard === null ? "never heard" : `heard ${ago(agent)}`, ...ageWords(agent), ...suspectWords(agent)].join("; ");
    if (item.title !== title) item.title = title;
  });
}

function drawCharts() {
  const times = data.times_ms, asPercent = (value) => Math.round(100 * value) + " %", asIs = (value) => value;
  const shape = [data.run_name, data.agents.length, data.has_truth].join(), key = [times.length, times[times.length - 1]].join();
  const charge = [key, data.agents.some((it) => it.believed)].join();
  drawChart("charge", shape, charge, () => ({
    min: 0, max: 1, format: asPercent, exact: percent, under: drawBands, over: drawThreshold,
    lines: data.agents.map((agent) => ({
      name: `aMussel ${agent.id}`, times, values: agent.charge,
      stroke: (plot) => timeColours(plot, data.times_ms, agent.status, STATUS_COLOURS),
      width: () => (marked() === agent.id ? 2.4 : marked() === null ? 1.2 : 0.5),
    })),
  }));
  // Of two compared runs each chart has both, the other one dashed.
  const lines = (of, style, step) => [data, ...runs.filter((it) => runs[0].differs && it !== data)]
    .map((run) => ({ name: runs[0].differs ? run.run_name : "", times: run.times_ms, values: of(run), stroke: style, width: 1.8, step, dash: run === data ? undefined : [6, 4] }));
  const most = (of) => Math.max(1, ...(runs[0].differs ? runs : [data]).map(of));
  drawChart("active", shape, key, () => ({ min: 0, max: most((it) => it.agents.length), format: asIs, lines: data.has_truth ? lines((it) => it.active, () => colour("above"), true) : [] }));
  drawChart("cost", shape, key, () => ({ min: 0, max: most((it) => it.cost[it.cost.length - 1]), format: asIs, exact: (value) => value.toFixed(1) + " m", lines: lines((it) => it.cost, () => ACCENT, true) }));
  drawChart("apad", shape, key, () => ({ min: 0, max: 1, format: asPercent, exact: percent, lines: lines((run) => run.apad.map((it) => it && it[3]), () => PAINT.way) }));
}

// Below the charges: where each lies with 95 %.
function drawBands(ctx, x, y) {
  const xs = data.times_ms.map(x), one = marked();
  for (const agent of data.agents) {
    if (!agent.low) continue;
    const style = one === agent.id ? ACCENT : STATUS_COLOURS[agent.status[agent.status.length - 1]];
    fillBand(ctx, xs, agent.low.map((it) => (it === null ? null : y(it))), agent.high.map(y), style, one === agent.id ? 0.35 : one === null ? 0.18 : 0.05);
  }
}

// Over the charges: the pool's threshold, and the estimate of the marked one.
function drawThreshold(ctx, x, y, pixel) {
  const dashed = (dash, style, width) => { ctx.setLineDash(dash.map((it) => it * pixel)); ctx.strokeStyle = style; ctx.lineWidth = width * pixel; };
  dashed([5, 4], SOFT, 1);
  stroke(ctx, SOFT, [data.times_ms[0], data.times_ms[data.times_ms.length - 1]].map((ms) => [x(ms), y(data.pool_threshold)]));
  const one = data.agents.find((it) => it.id === marked());
  if (!one || !one.believed) return;
  dashed([4, 3], INK, 1.2);
  stroke(ctx, INK, one.believed.flatMap((value, i) => (value === null ? [] : [[x(data.times_ms[i]), y(value)]])));
}

// A flight whose time is not its own has no speed.
function flyingWords(speed) {
  if (speed === null) return "flying";
  return speed ? `flying at ${speed} times real time` : "flying, and time stands still";
}

// The name of the run, why it ended, and the figures of its summary.
function showHeader() {
  $("name").textContent = data.name;
  $("whose").textContent = `${data.is_real ? "REAL aPad" : "simulated aPad"}${data.live ? "" : ", recorded"}`;
  const ended = data.ended_by === null ? (data.live ? flyingWords(data.live.speed) : "has not ended") : "ended by " + data.ended_by;
  $("about").textContent = [data.description, `${data.agents.length} aMussels, ${data.collection} / ${data.redeployment}, theta ${data.theta}, seed ${data.seed}; ${ended}`].filter(Boolean).join(" · ");
  const known = data.summary || {};
  const figures = [
    ["uptime at the end", known.uptime_paper && known.uptime_paper.mean.toFixed(2) + " %"],
    ["at equal charge", typeof known.uptime_equal_charge === "number" && known.uptime_equal_charge.toFixed(2) + " %"],
    ["charge gained", typeof known.charge_gain_mean === "number" && (100 * known.charge_gain_mean).toFixed(1) + " %"],
    ["active", known.active_mean !== undefined && known.active_mean !== null && known.active_mean.toFixed(2)],
    ["way flown", known.cost_m !== undefined && known.cost_m.toFixed(0) + " m"],
    ["way planned", known.planned_m !== undefined && known.planned_m.toFixed(0) + " m"],
    ["services", known.services], ["emptied", known.emptied], ["lost", known.amussels_lost],
    ["samples", known.samples_taken || undefined],
  ].filter(([, value]) => value !== undefined && value !== null && value !== false);
  $("figures").replaceChildren(...figures.map(([name, value]) => {
    const pair = document.createElement("div");
    pair.innerHTML = "<dt></dt><dd></dd>";
    pair.firstChild.textContent = name;
    pair.lastChild.textContent = value;
    return pair;
  }));
}

function matches([, category, text, agent]) {
  const kinds = $("kinds").value;
  const isChosen = kinds === "selected" ? agent !== null && agent === selected : !kinds || CATEGORIES[kinds].includes(category);
  return isChosen && text.toLowerCase().includes($("search").value.trim().toLowerCase());
}

// Lists the events of the chosen kinds that the search matches, newest last; a click shows the run at that time.
function listEvents() {
  $("events").replaceChildren();
  addEvents(data.events.filter(matches).slice(-MOST_EVENTS));
}

function addEvents(events) {
  $("events").append(...events.filter(matches).map(([ms, category, text]) => {
    const item = document.createElement("li");
    item.dataset.ms = ms;
    item.dataset.category = category;
    item.innerHTML = "<button><time></time><span></span></button>";
    item.querySelector("time").textContent = clock(ms);
    item.querySelector("span").textContent = text;
    item.firstChild.addEventListener("click", () => { leaveEnd(); show(ms); writeAddress(); });
    return item;
  }));
  while ($("events").children.length > MOST_EVENTS) $("events").firstChild.remove();
  listedMs = [...$("events").children].map((it) => +it.dataset.ms);
  const found = data.events.filter(matches).length, listed = listedMs.length;
  $("event-count").textContent = found > listed ? `the last ${listed} of ${found}` : found;
  showEventNow();
}

// Marks the newest event up to the time shown, and keeps it in sight.
let listedMs = [], newest = null;
function showEventNow() {
  const { i } = sampleAt(nowMs, listedMs), now = listedMs.length && listedMs[i] <= nowMs ? $("events").children[i] : null;
  if (now === newest && (!now || now.classList.contains("now"))) return;
  if (newest) newest.classList.remove("now");
  newest = now;
  if (!now) return;
  now.classList.add("now");
  const list = $("events");
  list.scrollTop += now.getBoundingClientRect().top - list.getBoundingClientRect().top - list.clientHeight / 2;
}

// Shows the chosen aPad's run: once for a page with one.
function setUp() {
  showHeader();
  const warnings = [];
  if (!data.has_truth) warnings.push("No truth was recorded in this run: batteries and places are what the supervisor believed.");
  if (data.agents.some((it) => it.rails) && !data.agents.every((it) => it.rails)) warnings.push("The modules of some boards are unknown: a second run was not the same.");
  if (data.dropped_lines) warnings.push(`${data.dropped_lines} line(s) of the journal could not be read.`);
  listEvents();
  $("warning").textContent = warnings.join(" ");
  $("warning").hidden = warnings.length === 0;
  $("shaded").hidden = !data.agents.some((it) => it.low);
  $("theta").textContent = data.theta === 1 ? "aMussels" : `aMussels, ${data.theta} times faster`;
  const [step, off] = [data.times_ms.length > 1 ? data.times_ms[1] - data.times_ms[0] : 0, data.thinned.track_m];
  $("thinned").textContent = `The charts have one value in ${step / 1000} s${off ? `; the track leaves out points up to ${off} m beside it` : ""}.`;
  showLegend();
  showPacketCards();
  makeMeasured();
  $("agents").replaceChildren(...data.agents.map((agent) => {
    const item = document.createElement("li");
    item.dataset.agent = agent.id;
    item.innerHTML = "<b></b><span></span>";
    item.firstChild.textContent = agent.id;
    item.dataset.status = "unknown";
    item.tabIndex = 0;
    item.addEventListener("pointerenter", (event) => { if (event.pointerType === "mouse") point(agent.id); });
    item.addEventListener("pointerleave", () => point(null));
    item.addEventListener("click", () => select(agent.id));
    item.addEventListener("keydown", (event) => { if (event.key === "Enter") select(agent.id); });
    return item;
  }));
  endMs = runs.reduce((ms, it) => Math.max(ms, it.times_ms[it.times_ms.length - 1]), 0);
  $("scrub").max = endMs / 1000;
}

// The legend has what is there: of the run, and of a live one so far.
function showLegend() {
  const there = new Set(data.agents.flatMap((it) => [...new Set(it.status)]).map((it) => STATUSES[it]));
  const fates = new Set();
  for (const packet of data.packets) {
    if (packet[5] === null) for (const [, outcome] of packet[6]) fates.add(FATES[outcome] || "missed");
    else fates.add("missed");
  }
  const marks = { apad: true, track: data.trace.length > 1, plan: data.plans.length > 0, fence: Boolean(data.fence), stop: data.stages.some((it) => it.stop) };
  for (const item of document.querySelectorAll("#legend li")) {
    const { status, fate: of } = item.dataset;
    if (item.dataset.mark) item.hidden = !marks[item.dataset.mark];
    else if (status === "suspect") item.hidden = data.suspects.length === 0;
    else item.hidden = of ? !fates.has(of) : status !== "home" && !there.has(status);
  }
}

function point(id) {
  if (pointed === id) return;
  pointed = id;
  restyle("charge");
  show(nowMs);
}

// Selects an aMussel, or none when it was the selected one.
function select(id) {
  selected = selected === id ? null : id;
  restyle("charge");
  if ($("kinds").value === "selected") listEvents();
  writeAddress();
  show(nowMs);
}

function writeAddress() {
  const parts = ["t=" + Math.round(nowMs) / 1000];
  if (selected !== null) parts.push("aMussel=" + selected);
  if (data !== runs[0]) parts.push(CHOSEN_BY + "=" + encodeURIComponent(data.run_name));
  if (zoom) parts.push("zoom=" + zoom.map((it) => Math.round(it / 1000)).join("-"));
  if ($("kinds").value) parts.push("events=" + $("kinds").value);
  if ($("why").open) parts.push("why=1");
  if (document.documentElement.dataset.theme) parts.push("theme=" + document.documentElement.dataset.theme);
  history.replaceState(null, "", "#" + parts.join("&"));
}

function setTheme(name) {
  if (name) document.documentElement.dataset.theme = name; else delete document.documentElement.dataset.theme;
  $("theme").setAttribute("aria-pressed", String(Boolean(name)));
  readColours();
}

function play(on) {
  if (on) document.body.classList.remove("following");
  playing = on ? { from: nowMs >= endMs ? 0 : nowMs, since: performance.now(), speed: +$("speed").value } : null;
  $("play").textContent = on ? "\u275A\u275A" : "\u25B6";
  $("play").setAttribute("aria-label", on ? "Pause" : "Play");
  if (on) requestAnimationFrame(frame); else if (!document.body.classList.contains("following")) writeAddress();
}

function frame() {
  if (!playing) return;
  show(playing.from + (performance.now() - playing.since) * playing.speed);
  if (nowMs >= endMs) { play(false); show(nowMs); } else requestAnimationFrame(frame);
}

function goToAddress() {
  const asked = new URLSearchParams(location.hash.slice(1));
  const seconds = Number(asked.get("t"));
  selected = asked.has("aMussel") ? Number(asked.get("aMussel")) : null;
  $("why").open = asked.has("why");
  const theme = asked.get("theme"), wanted = !asked.has("t") && matchMedia("(prefers-contrast: more)").matches ? "contrast" : "";
  setTheme(theme === "contrast" ? theme : wanted);
  const run = runs.find((it) => it.run_name === asked.get(CHOSEN_BY)) || runs[0];
  if (run !== data) choose(run);
  const kinds = asked.get("events") || "", span = (asked.get("zoom") || "").split("-").map((it) => 1000 * it);
  if ($("kinds").value !== kinds) { $("kinds").value = kinds; listEvents(); }
  zoomTo(span.length === 2 && span[1] > span[0] ? span : null);
  restyle("charge");
  show(Number.isFinite(seconds) ? 1000 * seconds : 0);
}

function choose(run) {
  data = run;
  $("apads").value = run.run_name;
  setUp();
}

// Looking at another time than the newest ends following a live run; live.js begins it again.
function leaveEnd() {
  play(false);
  document.body.classList.remove("following");
}

$("scrub").addEventListener("input", () => { leaveEnd(); show(1000 * $("scrub").value); });
$("scrub").addEventListener("change", writeAddress);
$("search").addEventListener("input", listEvents);
$("theme").addEventListener("click", () => { setTheme(document.documentElement.dataset.theme ? "" : "contrast"); writeAddress(); show(nowMs); });
$("why").addEventListener("toggle", () => { showWhy(); if (nowMs || selected !== null) writeAddress(); });
$("apads").hidden = runs.length < 2;
$("apads").replaceChildren(...runs.map((it) => new Option(it.run_name || it.name, it.run_name)));
$("apads").addEventListener("change", () => { choose(runs.find((it) => it.run_name === $("apads").value)); writeAddress(); show(nowMs); });
$("play").addEventListener("click", () => play(!playing));
$("speed").addEventListener("change", () => playing && play(true));
$("kinds").addEventListener("change", () => { listEvents(); writeAddress(); });
$("nearer").addEventListener("click", () => { zoomBy(0.5); writeAddress(); });
$("wider").addEventListener("click", () => { zoomBy(2); writeAddress(); });
$("whole").addEventListener("click", () => { zoomTo(null); writeAddress(); });
for (const id of ["map", "other-map"]) {
  $(id).addEventListener("click", (event) => {
    const shown = runs[0].differs ? [runs[id === "map" ? 0 : 1]] : runs;
    const found = musselAt(shown.map((it) => viewAt(nowMs, it)), sizeOf($(id)), event.offsetX, event.offsetY);
    if (found !== null && data.agents.some((it) => it.id === found)) select(found);
  });
}

hoverCanvas("uptime", barWords);
hoverCanvas("slots", slotWords);
for (const id of ["map", "other-map"]) {
  hoverCanvas(id, (x, y) => {
    const shown = runs[0].differs ? [runs[id === "map" ? 0 : 1]] : runs, views = shown.map((it) => viewAt(nowMs, it));
    const found = musselAt(views, sizeOf($(id)), x, y), agent = views.flatMap((it) => it.agents).find((it) => it.id === found);
    return agent ? [`aMussel ${chargeWords(agent)}`, STATUSES[agent.status], ...(agent.heard === null ? [] : [`heard ${ago(agent)}`]), ...ageWords(agent), ...suspectWords(agent)].join(", ") : "";
  });
}

// The keys, as the page's list of them tells.
const step = (samples) => { leaveEnd(); show(data.times_ms[Math.max(0, Math.min(data.times_ms.length - 1, sampleAt(nowMs, data.times_ms).i + samples))]); writeAddress(); };
const turn = (by) => {
  const ids = data.agents.map((it) => it.id), at = ids.indexOf(selected);
  select(ids[(at < 0 ? (by > 0 ? 0 : ids.length - 1) : at + by + ids.length) % ids.length]);
};
const KEYS = {
  " ": () => play(!playing),
  ArrowLeft: () => step(-1),
  ArrowRight: () => step(1),
  PageUp: () => step(-10),
  PageDown: () => step(10),
  Home: () => { leaveEnd(); show(0); writeAddress(); },
  End: () => { leaveEnd(); show(endMs); writeAddress(); },
  "+": () => $("nearer").click(),
  "-": () => $("wider").click(),
  0: () => $("whole").click(),
  n: () => turn(1),
  p: () => turn(-1),
  Escape: () => { if (selected !== null) select(selected); },
  c: () => $("theme").click(),
  w: () => { $("why").open = !$("why").open; },
  "/": () => $("search").focus(),
};
document.addEventListener("keydown", (event) => {
  const { target, key } = event;
  if (event.ctrlKey || event.metaKey || event.altKey || $("sure").open || (target.closest("input, select") && key !== "Escape")) return;
  if (!(key in KEYS) || (key === " " && target.closest("button, summary"))) return;
  event.preventDefault();
  KEYS[key]();
});
window.addEventListener("hashchange", goToAddress);
document.body.classList.toggle("compared", Boolean(runs[0].differs));
$("other").hidden = $("differences-card").hidden = !runs[0].differs;
if (runs[0].differs) runs.forEach((run, n) => put($(n ? "other-name" : "map-name"), run.run_name));
setUp();
const fitting = SPEEDS.find((speed) => endMs / 1000 / speed <= 90) || SPEEDS[SPEEDS.length - 1];
$("speed").replaceChildren(...SPEEDS.map((speed) => new Option(speed + " ×", speed, false, speed === fitting)));
goToAddress();
