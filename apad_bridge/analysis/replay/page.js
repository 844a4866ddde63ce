// Shows the run at one mission time, which the scrubber, the play button and the address change: #t=SECONDS, or
// #t=SECONDS&aMussel=ID, which also marks an aMussel as pointing at it does.

const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
let endMs = data.times_ms[data.times_ms.length - 1];
const MOST_EVENTS = 1000;
const SPEEDS = [1, 5, 20, 60, 300, 1200, 7200, 43200];
let nowMs = 0, playing = null, marked = null;

const percent = (value) => (100 * value).toFixed(1) + " %";

function clock(ms) {
  const s = Math.floor(ms / 1000), pad = (n) => String(n).padStart(2, "0");
  const days = Math.floor(s / 86400);
  return (days ? days + " d " : "") + pad(Math.floor(s / 3600) % 24) + ":" + pad(Math.floor(s / 60) % 60) + ":" + pad(s % 60);
}

// The last sample at or before a time, and the fraction of the way to the next sample.
function sampleAt(ms) {
  let low = 0, high = data.times_ms.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (data.times_ms[middle] <= ms) low = middle; else high = middle - 1;
  }
  const next = Math.min(low + 1, data.times_ms.length - 1);
  const span = data.times_ms[next] - data.times_ms[low];
  return { i: low, next, share: span ? (ms - data.times_ms[low]) / span : 0 };
}

const between = (a, b, share) => (a === null || b === null ? a : a + (b - a) * share);

function viewAt(ms) {
  const { i, next, share } = sampleAt(ms);
  const docks = data.docks[i];
  const agents = data.agents.map((agent) => {
    const dock = docks.indexOf(agent.id);
    return {
      id: agent.id,
      status: agent.status[i],
      dock: dock < 0 ? null : dock,
      charge: agent.charge[i],
      believed: agent.believed && agent.believed[i],
      within: agent.low && agent.low[i] !== null ? [agent.low[i], agent.high[i]] : null,
      uptime: agent.uptime[i],
      place: agent.north[i] === null ? null : [between(agent.north[i], agent.north[next], share), between(agent.east[i], agent.east[next], share)],
    };
  });
  const [a, b] = [data.apad[i], data.apad[next]];
  const apad = a && { place: [between(a[0], b[0], share), between(a[1], b[1], share)], heading: a[2], battery: a[3] };
  const stage = data.stages[data.stage[i]];
  return { i, nowMs: ms, agents, apad, docks, stage, way: wayOf(stage, agents), active: data.active[i], cost: data.cost[i] };
}

// The places of the plan's unfinished steps.
function wayOf({ phase, plan }, agents) {
  if (!plan || phase === "ended") return [];
  const places = plan.steps.slice(plan.done).map(([id]) => {
    const agent = agents.find((it) => it.id === id);
    return plan.what === "collect" ? agent && agent.dock === null && agent.place : data.homes[id];
  });
  return places.filter(Boolean);
}

function show(ms) {
  nowMs = Math.max(0, Math.min(endMs, ms));
  const view = viewAt(nowMs);
  $("scrub").value = nowMs / 1000;
  $("mission-clock").textContent = clock(nowMs);
  $("agent-clock").textContent = clock(nowMs * data.theta);
  document.body.dataset.timeMs = Math.round(nowMs);
  showWords(view);
  showAgents(view);
  showEventNow();
  drawMap($("map"), data, view, marked);
  drawPlots(view);
}

function showWords({ stage, docks, agents, active, cost, apad }) {
  $("phase").textContent = stage.phase || "not begun";
  $("primitive").textContent = stage.primitive || "none";
  $("docks").textContent = docks.map((id) => (id === null ? "free" : id)).join(" · ");
  $("plan").replaceChildren(...planWords(stage.plan));
  const charges = agents.map((it) => it.charge).filter((it) => it !== null);
  const mean = (list) => list.reduce((a, b) => a + b, 0) / list.length;
  const one = agents.find((it) => it.id === marked);
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
    item.dataset.status = STATUSES[agent.status];
    item.lastChild.textContent = agent.charge === null ? "?" : (100 * agent.charge).toFixed(0) + " %";
    item.classList.toggle("marked", marked === agent.id);
  });
}

function drawPlots(view) {
  const times = data.times_ms;
  const ofAgent = (agent, n) => ({ values: agent.charge, colour: STATUS_COLOURS[view.agents[n].status], width: marked === agent.id ? 2.2 : marked === null ? 1.2 : 0.5 });
  const bands = data.agents.filter((it) => it.low).map((it) => ({
    low: it.low, high: it.high, colour: marked === it.id ? ACCENT : STATUS_COLOURS[view.agents[data.agents.indexOf(it)].status],
    alpha: marked === it.id ? 0.35 : marked === null ? 0.18 : 0.05,
  }));
  const chosen = data.agents.find((it) => it.id === marked);
  const estimates = chosen && chosen.believed ? [{ values: chosen.believed, colour: INK, width: 1.2, dash: [4, 3] }] : [];
  const asPercent = (value) => Math.round(100 * value) + " %";
  drawLines($("charge"), times, nowMs, [...bands, ...data.agents.map(ofAgent), ...estimates], { min: 0, max: 1, format: asPercent, threshold: data.pool_threshold });
  const last = data.times_ms.length - 1;
  drawBars($("uptime"), data.agents.map((agent, n) => ({ label: agent.id, value: agent.uptime[view.i], full: agent.uptime[last], colour: STATUS_COLOURS[view.agents[n].status] })), marked);
  drawLines($("active"), times, nowMs, data.has_truth ? [{ values: data.active, colour: colour("above"), width: 1.8, step: true }] : [], { min: 0, max: Math.max(1, data.agents.length), format: (value) => value });
  drawLines($("cost"), times, nowMs, [{ values: data.cost, colour: ACCENT, width: 1.8, step: true }], { min: 0, max: Math.max(1, data.cost[last]), format: (value) => value });
  drawLines($("apad"), times, nowMs, [{ values: data.apad.map((it) => it && it[3]), colour: "#c77d0a", width: 1.8 }], { min: 0, max: 1, format: asPercent });
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
    item.firstChild.addEventListener("click", () => { leaveEnd(); show(ms); history.replaceState(null, "", "#t=" + ms / 1000); });
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

function setUp() {
  showHeader();
  const warnings = [];
  if (!data.has_truth) warnings.push("No truth was recorded in this run: batteries and places are what the supervisor believed.");
  if (data.dropped_lines) warnings.push(`${data.dropped_lines} line(s) of the journal could not be read.`);
  $("search").addEventListener("input", listEvents);
  listEvents();
  $("warning").textContent = warnings.join(" ");
  $("warning").hidden = warnings.length === 0;
  $("shaded").hidden = !data.agents.some((it) => it.low);
  $("theta").textContent = data.theta === 1 ? "aMussels" : `aMussels, ${data.theta} times faster`;
  $("agents").replaceChildren(...data.agents.map((agent) => {
    const item = document.createElement("li");
    item.dataset.agent = agent.id;
    item.innerHTML = "<b></b><span></span>";
    item.firstChild.textContent = agent.id;
    item.addEventListener("mouseenter", () => { marked = agent.id; show(nowMs); });
    item.addEventListener("mouseleave", () => { marked = null; show(nowMs); });
    return item;
  }));
  $("scrub").max = endMs / 1000;
  const fitting = SPEEDS.find((speed) => endMs / 1000 / speed <= 90) || SPEEDS[SPEEDS.length - 1];
  $("speed").replaceChildren(...SPEEDS.map((speed) => new Option(speed + " ×", speed, false, speed === fitting)));
}

function play(on) {
  if (on) document.body.classList.remove("following");
  playing = on ? { from: nowMs >= endMs ? 0 : nowMs, since: performance.now(), speed: +$("speed").value } : null;
  $("play").textContent = on ? "\u275A\u275A" : "\u25B6";
  $("play").setAttribute("aria-label", on ? "Pause" : "Play");
  if (on) requestAnimationFrame(frame);
}

function frame() {
  if (!playing) return;
  show(playing.from + (performance.now() - playing.since) * playing.speed);
  if (nowMs >= endMs) play(false); else requestAnimationFrame(frame);
}

function goToAddress() {
  const asked = new URLSearchParams(location.hash.slice(1));
  const seconds = Number(asked.get("t"));
  marked = asked.has("aMussel") ? Number(asked.get("aMussel")) : null;
  show(Number.isFinite(seconds) ? 1000 * seconds : 0);
}

// Looking at another time than the newest ends following a live run; live.js begins it again.
function leaveEnd() {
  play(false);
  document.body.classList.remove("following");
}

$("scrub").addEventListener("input", () => { leaveEnd(); show(1000 * $("scrub").value); });
$("scrub").addEventListener("change", () => history.replaceState(null, "", "#t=" + Math.round(nowMs / 1000)));
$("play").addEventListener("click", () => play(!playing));
$("speed").addEventListener("change", () => playing && play(true));
for (const id of ["charge", "active", "cost", "apad"]) {
  $(id).addEventListener("click", (event) => {
    leaveEnd();
    show(endMs * (event.offsetX - 40) / ($(id).clientWidth - 50));
  });
}
document.addEventListener("keydown", (event) => {
  if (event.key === " " && !["BUTTON", "INPUT"].includes(event.target.tagName)) { event.preventDefault(); play(!playing); }
});
window.addEventListener("hashchange", goToAddress);
window.addEventListener("resize", () => show(nowMs));
setUp();
goToAddress();
