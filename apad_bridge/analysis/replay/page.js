// Shows a run at one mission time. The address holds what is shown: #t=SECONDS, and where chosen &aMussel=ID, &aPad=NAME,
// &why=1 (the reasons of a plan) and &theme=contrast. So an address that is sent to somebody shows the same moment there.

const runs = JSON.parse(document.getElementById("data").textContent);
let data = runs[0];
const $ = (id) => document.getElementById(id);
const MOST_EVENTS = 1000;
const MOST_PACKETS = 40;
const SPEEDS = [1, 5, 20, 60, 300, 1200, 7200, 43200];
const WHOLE_MS = 400;
let wholeMs = 0, statuses = "";
let endMs = 0, nowMs = 0, playing = null, pointed = null, selected = null;
const marked = () => (pointed === null ? selected : pointed);

const percent = (value) => (100 * value).toFixed(1) + " %";

function clock(ms) {
  const s = Math.floor(ms / 1000), pad = (n) => String(n).padStart(2, "0");
  const days = Math.floor(s / 86400);
  return (days ? days + " d " : "") + pad(Math.floor(s / 3600) % 24) + ":" + pad(Math.floor(s / 60) % 60) + ":" + pad(s % 60);
}

// The last sample at or before a time, and the fraction of the way to the next sample.
function sampleAt(ms, times) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= ms) low = middle; else high = middle - 1;
  }
  const next = Math.min(low + 1, times.length - 1);
  const span = times[next] - times[low];
  return { i: low, next, share: span ? Math.min(1, (ms - times[low]) / span) : 0 };
}

const between = (a, b, share) => (a === null || b === null ? a : a + (b - a) * share);

function viewAt(ms, data) {
  const { i, next, share } = sampleAt(ms, data.times_ms);
  const docks = data.docks[i];
  const agents = data.agents.map((agent) => {
    const dock = docks.indexOf(agent.id);
    return {
      id: agent.id,
      status: agent.status[i],
      dock: dock < 0 ? null : dock,
      charge: agent.charge[i],
      secondary: agent.secondary[i],
      state: agent.state[i],
      believed: agent.believed && agent.believed[i],
      within: agent.low && agent.low[i] !== null ? [agent.low[i], agent.high[i]] : null,
      uptime: agent.uptime[i],
      place: agent.north[i] === null ? null : [between(agent.north[i], agent.north[next], share), between(agent.east[i], agent.east[next], share)],
    };
  });
  const [a, b] = [data.apad[i], data.apad[next]];
  const apad = a && { place: [between(a[0], b[0], share), between(a[1], b[1], share)], heading: a[2], battery: a[3] };
  const stage = data.stages[data.stage[i]];
  return { i, nowMs: ms, agents, apad, docks, stage, way: wayOf(stage, agents, data.homes), active: data.active[i], cost: data.cost[i] };
}

// The places of the plan's unfinished steps.
function wayOf({ phase, plan }, agents, homes) {
  if (!plan || phase === "ended") return [];
  const places = plan.steps.slice(plan.done).map(([id]) => {
    const agent = agents.find((it) => it.id === id);
    return plan.what === "collect" ? agent && agent.dock === null && agent.place : homes[id];
  });
  return places.filter(Boolean);
}

function show(ms) {
  nowMs = Math.max(0, Math.min(endMs, ms));
  const others = runs.filter((it) => it !== data);
  const view = viewAt(nowMs, data), views = [...others.map((it) => viewAt(nowMs, it)), view];
  $("scrub").value = nowMs / 1000;
  $("mission-clock").textContent = clock(nowMs);
  $("agent-clock").textContent = clock(nowMs * data.theta);
  document.body.dataset.timeMs = Math.round(nowMs);
  // While it plays, only the map, the clocks and the charts' lines of the time are drawn anew at each frame.
  const isWhole = !playing || performance.now() - wholeMs > WHOLE_MS;
  if (isWhole) {
    wholeMs = performance.now();
    statuses = view.agents.map((it) => it.status).join("");
    showWords(view);
    showAgents(view);
    showEventNow();
    showWhy();
    showPackets();
    drawBars($("uptime"), data.agents.map((agent, n) => ({ label: agent.id, value: agent.uptime[view.i], full: agent.uptime[agent.uptime.length - 1], colour: STATUS_COLOURS[view.agents[n].status] })), marked());
  }
  const packets = packetsAround();
  drawMap($("map"), [...others, data], views, marked(), packets);
  drawPlots(view);
  showSelected(view);
}

function showWords({ stage, docks, agents, active, cost, apad }) {
  $("phase").textContent = stage.phase || "not begun";
  $("primitive").textContent = stage.primitive || "none";
  $("docks").textContent = docks.map((id) => (id === null ? "free" : id)).join(" · ");
  $("plan").replaceChildren(...planWords(stage.plan));
  const charges = agents.map((it) => it.charge).filter((it) => it !== null);
  const mean = (list) => list.reduce((a, b) => a + b, 0) / list.length;
  const one = agents.find((it) => it.id === marked());
  $("charge-now").textContent = one ? chargeWords(one) : charges.length ? `mean ${percent(mean(charges))}, least ${percent(Math.min(...charges))}` : "unknown";
  $("uptime-now").textContent = data.has_truth ? `mean ${mean(agents.map((it) => it.uptime)).toFixed(1)} %` : "no truth was recorded";
  $("active-now").textContent = data.has_truth ? `${active} of ${agents.length}` : "no truth was recorded";
  $("cost-now").textContent = cost.toFixed(0) + " m";
  $("apad-now").textContent = apad && apad.battery !== null ? percent(apad.battery) : "unknown";
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

function showAgents({ agents }) {
  agents.forEach((agent, n) => {
    const item = $("agents").children[n];
    const words = agent.charge === null ? "?" : (100 * agent.charge).toFixed(0) + " %";
    if (item.dataset.status !== STATUSES[agent.status]) item.dataset.status = STATUSES[agent.status];
    if (item.lastChild.textContent !== words) item.lastChild.textContent = words;
    item.classList.toggle("marked", marked() === agent.id);
    item.classList.toggle("selected", selected === agent.id);
  });
}

function drawPlots(view) {
  const times = data.times_ms, one = marked(), last = times.length - 1;
  const colourOf = (n) => STATUS_COLOURS[view.agents[n].status];
  const asPercent = (value) => Math.round(100 * value) + " %";
  const charges = () => {
    const bands = data.agents.map((it, n) => ({ low: it.low, high: it.high, colour: one === it.id ? ACCENT : colourOf(n), alpha: one === it.id ? 0.35 : one === null ? 0.18 : 0.05 }));
    const lines = data.agents.map((it, n) => ({ values: it.charge, colour: colourOf(n), width: one === it.id ? 2.2 : one === null ? 1.2 : 0.5 }));
    const chosen = data.agents.find((it) => it.id === one);
    const estimates = chosen && chosen.believed ? [{ values: chosen.believed, colour: INK, width: 1.2, dash: [4, 3] }] : [];
    return [...bands.filter((it) => it.low), ...lines, ...estimates];
  };
  const of = (name) => [name, data.apad_name].join();
  drawLines($("charge"), [of("charge"), one, statuses], times, nowMs, charges, { min: 0, max: 1, format: asPercent, threshold: data.pool_threshold });
  drawLines($("active"), of("active"), times, nowMs, () => (data.has_truth ? [{ values: data.active, colour: colour("above"), width: 1.8, step: true }] : []), { min: 0, max: Math.max(1, data.agents.length), format: (value) => value });
  drawLines($("cost"), of("cost"), times, nowMs, () => [{ values: data.cost, colour: ACCENT, width: 1.8, step: true }], { min: 0, max: Math.max(1, data.cost[last]), format: (value) => value });
  drawLines($("apad"), of("apad"), times, nowMs, () => [{ values: data.apad.map((it) => it && it[3]), colour: PAINT.way, width: 1.8 }], { min: 0, max: 1, format: asPercent });
}

// The name of the run, why it ended, and the figures of its summary.
function showHeader() {
  $("name").textContent = data.name;
  const ended = data.ended_by === null ? "has not ended" : "ended by " + data.ended_by;
  $("about").textContent = [data.description, `${data.agents.length} aMussels, ${data.collection} / ${data.redeployment}, theta ${data.theta}, seed ${data.seed}; ${ended}`].filter(Boolean).join(" · ");
  const known = data.summary || {};
  const figures = [
    ["uptime", known.uptime_paper && known.uptime_paper.mean.toFixed(2) + " %"],
    ["active", known.active_mean !== undefined && known.active_mean !== null && known.active_mean.toFixed(2)],
    ["cost", known.cost_m !== undefined && known.cost_m.toFixed(0) + " m"],
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

const matches = ([, , text]) => text.toLowerCase().includes($("search").value.trim().toLowerCase());

// Lists the events that the search matches, newest last; a click shows the run at that time.
function listEvents() {
  $("events").replaceChildren();
  addEvents(data.events.filter(matches).slice(-MOST_EVENTS));
}

function addEvents(events) {
  $("events").append(...events.filter(matches).map(([ms, kind, text]) => {
    const item = document.createElement("li");
    item.dataset.ms = ms;
    item.dataset.kind = kind;
    item.innerHTML = "<button><time></time><span></span></button>";
    item.querySelector("time").textContent = clock(ms);
    item.querySelector("span").textContent = text;
    item.firstChild.addEventListener("click", () => { leaveEnd(); show(ms); writeAddress(); });
    return item;
  }));
  while ($("events").children.length > MOST_EVENTS) $("events").firstChild.remove();
  const found = data.events.filter(matches).length, listed = $("events").children.length;
  $("event-count").textContent = found > listed ? `the last ${listed} of ${found}` : found;
  showEventNow();
}

// Marks the newest event up to the time shown, and keeps it in sight.
function showEventNow() {
  const items = [...$("events").children];
  const now = items.findLast((it) => it.dataset.ms <= nowMs);
  const before = $("events").querySelector(".now");
  if (now === (before || undefined)) return;
  if (before) before.classList.remove("now");
  if (!now) return;
  now.classList.add("now");
  $("events").scrollTop = now.offsetTop - $("events").offsetTop - $("events").clientHeight / 2;
}

// Shows the chosen aPad's run: once for a page with one.
function setUp() {
  showHeader();
  const warnings = [];
  if (!data.has_truth) warnings.push("No truth was recorded in this run: batteries and places are what the supervisor believed.");
  if (data.dropped_lines) warnings.push(`${data.dropped_lines} line(s) of the journal could not be read.`);
  listEvents();
  $("warning").textContent = warnings.join(" ");
  $("warning").hidden = warnings.length === 0;
  $("shaded").hidden = !data.agents.some((it) => it.low);
  $("theta").textContent = data.theta === 1 ? "aMussels" : `aMussels, ${data.theta} times faster`;
  $("packets-card").hidden = !data.live && !runs.some((it) => it.packets.length);
  for (const item of document.querySelectorAll("#legend [data-fate]")) item.hidden = $("packets-card").hidden;
  $("agents").replaceChildren(...data.agents.map((agent) => {
    const item = document.createElement("li");
    item.dataset.agent = agent.id;
    item.innerHTML = "<b></b><span></span>";
    item.firstChild.textContent = agent.id;
    item.dataset.status = "unknown";
    item.tabIndex = 0;
    item.addEventListener("mouseenter", () => { pointed = agent.id; show(nowMs); });
    item.addEventListener("mouseleave", () => { pointed = null; show(nowMs); });
    item.addEventListener("click", () => select(agent.id));
    item.addEventListener("keydown", (event) => { if (event.key === "Enter") select(agent.id); });
    return item;
  }));
  endMs = runs.reduce((ms, it) => Math.max(ms, it.times_ms[it.times_ms.length - 1]), 0);
  $("scrub").max = endMs / 1000;
}

// Selects an aMussel, or none when it was the selected one.
function select(id) {
  selected = selected === id ? null : id;
  writeAddress();
  show(nowMs);
}

function writeAddress() {
  const parts = ["t=" + Math.round(nowMs) / 1000];
  if (selected !== null) parts.push("aMussel=" + selected);
  if (data !== runs[0]) parts.push("aPad=" + encodeURIComponent(data.apad_name));
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
  const run = runs.find((it) => it.apad_name === asked.get("aPad")) || runs[0];
  if (run !== data) choose(run);
  show(Number.isFinite(seconds) ? 1000 * seconds : 0);
}

function choose(run) {
  data = run;
  $("apads").value = run.apad_name;
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
$("apads").replaceChildren(...runs.map((it) => new Option(it.apad_name || it.name, it.apad_name)));
$("apads").addEventListener("change", () => { choose(runs.find((it) => it.apad_name === $("apads").value)); writeAddress(); show(nowMs); });
$("play").addEventListener("click", () => play(!playing));
$("speed").addEventListener("change", () => playing && play(true));
for (const id of ["charge", "active", "cost", "apad"]) {
  $(id).addEventListener("click", (event) => {
    leaveEnd();
    show(data.times_ms[data.times_ms.length - 1] * (event.offsetX - 40) / ($(id).clientWidth - 50));
    writeAddress();
  });
}
document.addEventListener("keydown", (event) => {
  if (event.key === " " && !["BUTTON", "INPUT"].includes(event.target.tagName)) { event.preventDefault(); play(!playing); }
});
window.addEventListener("hashchange", goToAddress);
window.addEventListener("resize", () => show(nowMs));
setUp();
const fitting = SPEEDS.find((speed) => endMs / 1000 / speed <= 90) || SPEEDS[SPEEDS.length - 1];
$("speed").replaceChildren(...SPEEDS.map((speed) => new Option(speed + " ×", speed, false, speed === fitting)));
goToAddress();
