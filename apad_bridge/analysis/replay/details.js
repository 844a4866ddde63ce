// The reasons of a plan, acoustic packets with what became of them, and one aMussel over time.

const OUTCOMES = { received: "received", transmitting: "half duplex", collided: "collided", in_air: "in air", cut: "no link", lost: "lost" };
const nodeName = (id) => (id === 0 ? "aPad" : id);
const words = (name) => name.replace(/_/g, " ");

// A value of a plan's line in words, whatever its version wrote.
function inWords(value) {
  if (Array.isArray(value)) return value.map((it) => (it && it.agent !== undefined ? String(it.agent) : inWords(it))).join(", ") || "none";
  if (value && typeof value === "object") return Object.entries(value).map(([name, it]) => `${words(name)} ${inWords(it)}`).join("; ");
  return typeof value === "number" && !Number.isInteger(value) ? value.toFixed(2) : String(value);
}

let shownPlan;
function showWhy() {
  const plan = data.plans.findLast((it) => it.t <= nowMs) || null;
  if (!$("why").open || plan === shownPlan) return;
  shownPlan = plan;
  const { t, what, strategy, steps, costs, beliefs, ...others } = plan || {};
  const order = (plan ? steps : []).map((it) => it.agent);
  $("candidates").replaceChildren(...(plan ? beliefs : []).map((it) => {
    const row = document.createElement("tr"), place = order.indexOf(it.id);
    for (const text of [it.id, percent(it.charge), `${it.north_m.toFixed(1)}, ${it.east_m.toFixed(1)}`, place < 0 ? "not chosen" : place + 1]) {
      row.append(Object.assign(document.createElement("td"), { textContent: text }));
    }
    return row;
  }));
  const lines = plan ? [[`at ${clock(t)}`, `to ${what}, by ${strategy}`], ["costs", inWords(costs)], ...Object.entries(others).map(([name, it]) => [words(name), inWords(it)])] : [["", "no plan yet"]];
  $("reasons").replaceChildren(...lines.map(([name, text]) => Object.assign(document.createElement("p"), { textContent: name ? `${name}: ${text}` : text })));
}

const isOf = ([, , sender, , , , heard], id) => id === null || sender === id || heard.some(([listener]) => listener === id);

// The newest packets of the last moments, of the selected aMussel where there is one, with their ages from 0 to 1.
function packetsAround() {
  const lasting = Math.max(PACKET_MS, playing ? 500 * playing.speed : 0);
  const found = [];
  for (const run of runs) {
    for (let i = firstAfter(run.packets, nowMs) - 1; i >= 0 && run.packets[i][0] > nowMs - lasting && found.length < MOST_PACKETS; i--) {
      if (isOf(run.packets[i], selected)) found.push({ packet: run.packets[i], age: (nowMs - run.packets[i][0]) / lasting });
    }
  }
  return found;
}

function fate([, , , , address, unsent, heard, far]) {
  if (unsent !== null) return `not sent: ${unsent}`;
  const by = new Map();
  for (const [listener, outcome] of heard) by.set(outcome, [...(by.get(outcome) || []), nodeName(listener)]);
  const told = [...by].map(([outcome, who]) => `${OUTCOMES[outcome] || words(outcome)}: ${who.length > 12 ? who.length + " listeners" : who.join(" ")}`);
  if (far) told.push(`out of range or too weak: ${far}`);
  return told.join("; ") || "nobody listened";
}

let shownPackets = "";
function showPackets() {
  if ($("packets-card").hidden) return;
  const end = firstAfter(data.packets, nowMs), key = [end, selected, data.apad_name].join();
  if (key === shownPackets) return;
  shownPackets = key;
  const rows = [];
  for (let i = end - 1; i >= 0 && rows.length < MOST_PACKETS; i--) if (isOf(data.packets[i], selected)) rows.push(data.packets[i]);
  $("packet-count").textContent = `${end + data.earlier_packets} so far` + (selected === null ? "" : `; shown: those of aMussel ${selected}`);
  $("packets").replaceChildren(...rows.map((packet) => {
    const item = document.createElement("li");
    item.innerHTML = "<time></time><b></b><span></span>";
    item.children[0].textContent = clock(packet[0]);
    item.children[1].textContent = `${nodeName(packet[2])} ${words(packet[3])}`;
    item.children[2].textContent = fate(packet);
    const [, outcome] = packet[6].find(([, it]) => it !== "received") || [];
    item.style.setProperty("--c", packet[5] !== null || outcome ? fateColour(outcome) : PAINT.received);
    return item;
  }));
}

// The selected aMussel: its states as a strip, both batteries, and its packets: sent above the line, received below it.
function showSelected(view) {
  const agent = data.agents.find((it) => it.id === selected);
  $("one-card").hidden = !agent;
  if (!agent) return;
  const now = view.agents.find((it) => it.id === selected);
  const state = now.state === null ? "unknown" : data.states[now.state];
  const secondary = now.secondary === null ? "unknown" : percent(now.secondary);
  $("one-now").textContent = `${selected}: ${state}; primary ${now.charge === null ? "unknown" : percent(now.charge)}, secondary ${secondary}`;
  const times = data.times_ms, own = data.packets.filter((it) => isOf(it, selected));
  const key = ["one", data.apad_name, selected, times.length, own.length, document.documentElement.dataset.theme].join();
  const { ctx, width, height } = picture($("one"), key, (inner, w, h) => drawSelected(inner, w, h, agent, own));
  drawNow(ctx, boxOf(width, height), nowMs, times[times.length - 1] || 1);
}

function drawSelected(ctx, width, height, agent, packets) {
  const times = data.times_ms, box = boxOf(width, height), endMs = times[times.length - 1] || 1;
  const x = (ms) => box.left + (box.right - box.left) * ms / endMs;
  drawChart(ctx, width, height, times, [
    { values: agent.charge, colour: colour("above"), width: 2 },
    { values: agent.secondary, colour: colour("charging"), width: 2, dash: [5, 3] },
  ], { min: -0.6, max: 1, format: (value) => (value < 0 ? "" : Math.round(100 * value) + " %") });
  const row = (share) => box.bottom - (box.bottom - box.top) * share;
  agent.state.forEach((state, i) => {
    if (state === null || (i && agent.state[i - 1] === state)) return;
    let end = i;
    while (end + 1 < times.length && agent.state[end + 1] === state) end++;
    const from = x(times[i]), to = x(times[Math.min(end + 1, times.length - 1)]);
    ctx.fillStyle = `hsl(${(state * 137) % 360} 55% 62%)`;
    ctx.fillRect(from, row(0.32), Math.max(1, to - from), row(0.22) - row(0.32));
    const name = data.states[state];
    if (ctx.measureText(name).width < to - from - 4) { ctx.fillStyle = "#000"; ctx.textAlign = "center"; ctx.fillText(name, (from + to) / 2, row(0.27)); }
  });
  ctx.lineWidth = 1.5;
  for (const packet of packets) {
    const sent = packet[2] === agent.id;
    const [, outcome] = (sent ? packet[6].find(([, it]) => it === "received") || packet[6][0] : packet[6].find(([id]) => id === agent.id)) || [];
    stroke(ctx, fateColour(packet[5] === null ? outcome : "unsent"), [[x(packet[0]), row(0.1)], [x(packet[0]), row(sent ? 0.18 : 0.02)]]);
  }
  stroke(ctx, LINE, [[box.left, row(0.1)], [box.right, row(0.1)]]);
}
