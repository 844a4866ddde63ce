// The reasons of a plan, acoustic packets with what became of them and their timeslots, one aMussel over time, and what differs
// between two runs.

const OUTCOMES = { received: "received", transmitting: "half duplex", collided: "collided", in_air: "in air", cut: "no link", lost: "lost" };
const SHOWN_FRAMES = 8;
const nodeName = (id) => (id === 0 ? "aPad" : id < 0 ? `aPad no. ${-id}` : id);
const words = (name) => name.replace(/_/g, " ");

// A table of texts, the first row of them its head; `chosen` marks a column or a row of the plan's own.
function fillTable(id, caption, rows, isChosen) {
  $(id).replaceChildren(...(rows.length > 1 ? [Object.assign(document.createElement("caption"), { textContent: caption })] : []), ...(rows.length > 1 ? rows : []).map((cells, n) => {
    const line = document.createElement("tr");
    line.append(...cells.map((text, k) => Object.assign(document.createElement(n && k ? "td" : "th"), { textContent: text, className: isChosen(n, k) ? "chosen" : "" })));
    return line;
  }));
}

const fixed = (value, digits) => (value === undefined || value === null ? "" : value.toFixed(digits));

// The table that `musselbed explain` prints: the plan beside its runner-up and the others, and the candidates.
let shownPlan;
function showWhy() {
  const plan = data.plans.findLast((it) => it.t <= nowMs) || null;
  if (!$("why").open || plan === shownPlan) return;
  shownPlan = plan;
  const { t, what, strategy, steps, costs, beliefs, options, exchanged, unexplained } = plan || {};
  const order = (plan ? steps : []).map((it) => it.agent), weighed = options || [];
  const lines = plan ? [
    `${clock(t)}: ${strategy} planned to ${what === "collect" ? "collect" : "release"} ${order.join(", ") || "nobody"}`,
    ...(exchanged || []).map((it) => `on the same tour ${it.released} takes the place of ${it.collected}`),
    `way planned ${fixed(costs.distance_m, 1)} m, demand ${fixed(costs.demand, 2)} batteries; scaled ${fixed(costs.distance_cost, 1)} and ${fixed(costs.energy_cost, 1)}`,
    weighed.length > 1 ? `the runner-up costs ${fixed(weighed[1].cost - weighed[0].cost, 3)} more` : weighed.length ? "" : `no reasons given${unexplained ? `: ${unexplained}` : ""}`,
  ] : ["no plan yet"];
  $("reasons").replaceChildren(...lines.filter(Boolean).map((text) => Object.assign(document.createElement("p"), { textContent: text })));
  const parts = weighed.length ? Object.keys(weighed[0].parts) : [];
  fillTable("options", "The plans that were weighed, by the strategy's own cost: the least is the best", weighed.length ? [
    ["", ...weighed.map((_, n) => ["the plan", "runner-up"][n] || `${n + 1}.`)],
    ["aMussels", ...weighed.map((it) => it.agents.join(", "))],
    ["cost", ...weighed.map((it) => fixed(it.cost, 3))],
    ...parts.map((name) => [words(name), ...weighed.map((it) => fixed(it.parts[name] || 0, 3))]),
  ] : [], (_, k) => k === 1);
  fillTable("candidates", "The candidates, as they were believed", [
    ["aMussel", "place in the plan", "charge", "second battery", "unserved", "north, east", ...data.quantities.map(([, text, unit]) => `${text} ${unit}`.trim())],
    ...(plan ? beliefs : []).map((it) => [it.id, order.indexOf(it.id) + 1 || "", percent(it.charge), it.secondary === undefined ? "" : percent(it.secondary),
      it.unserved_s === undefined ? "" : clock(1000 * it.unserved_s), `${fixed(it.north_m, 1)}, ${fixed(it.east_m, 1)}`,
      ...data.quantities.map(([name]) => fixed((it.reported || {})[name], 2))]),
  ], (n) => n > 0 && order.includes(plan.beliefs[n - 1].id));
}

const isOf = ([, , sender, , , , heard], id) => id === null || sender === id || heard.some(([listener]) => listener === id);

// The newest packets of the last moments, of the selected aMussel where there is one, with their ages from 0 to 1.
function packetsAround() {
  const lasting = Math.max(PACKET_MS, playing ? 500 * playing.speed : 0);
  const found = [];
  for (const run of runs) {
    for (let i = firstAfter(run.packets, nowMs) - 1; i >= 0 && run.packets[i][0] > nowMs - lasting && found.length < MOST_PACKETS; i--) {
      if (isOf(run.packets[i], selected)) found.push({ run, packet: run.packets[i], age: (nowMs - run.packets[i][0]) / lasting });
    }
  }
  return found;
}

function fate([, , , , , unsent, heard, far]) {
  if (unsent !== null) return `not sent: ${unsent}`;
  const by = new Map();
  for (const [listener, outcome] of heard) by.set(outcome, [...(by.get(outcome) || []), nodeName(listener)]);
  const told = [...by].map(([outcome, who]) => `${OUTCOMES[outcome] || words(outcome)}: ${who.length > 12 ? who.length + " listeners" : who.join(" ")}`);
  if (far) told.push(`out of range or too weak: ${far}`);
  return told.join("; ") || "nobody listened";
}

// A run without sound has no packets; a live one may have its first one later.
function showPacketCards() {
  $("packets-card").hidden = !runs.some((it) => it.packets.length);
  $("slots-card").hidden = !data.timeslots || !data.packets.length;
}

let shownPackets = "";
function showPackets() {
  if ($("packets-card").hidden) return;
  const end = firstAfter(data.packets, nowMs), key = [end, selected, data.run_name, themeNow()].join();
  if (key === shownPackets) return;
  shownPackets = key;
  const rows = [];
  for (let i = end - 1; i >= 0 && rows.length < MOST_PACKETS; i--) if (isOf(data.packets[i], selected)) rows.push(data.packets[i]);
  $("packet-count").textContent = `${end + data.earlier_packets} so far` + (selected === null ? "" : `; shown: those of aMussel ${selected}`);
  const list = $("packets");
  while (list.children.length > rows.length) list.lastChild.remove();
  while (list.children.length < rows.length) {
    const item = document.createElement("li");
    item.append(...["time", "b", "span"].map((it) => document.createElement(it)));
    list.append(item);
  }
  rows.forEach((packet, n) => {
    const item = list.children[n], slot = data.timeslots && packet[8] !== null ? `, slot ${packet[8]}` : "";
    put(item.children[0], clock(packet[0]));
    put(item.children[1], `${nodeName(packet[2])} ${words(packet[3])}${slot}`);
    put(item.children[2], fate(packet));
    item.style.setProperty("--c", fateOf(packet));
  });
}

// The colour of a packet as a whole: unsent, missed by one of its listeners, or received.
function fateOf([, , , , , unsent, heard]) {
  const [, outcome] = heard.find(([, it]) => it !== "received") || [];
  return unsent !== null || outcome ? fateColour(outcome) : PAINT.received;
}

// The timeslots of the last frames in which somebody transmitted: a row for each frame, each packet where and as long as it was
// sent, by the aMussels' time.
let shownSlots = "";
function showSlots() {
  if ($("slots-card").hidden) return;
  const end = firstAfter(data.packets, nowMs), { width, height } = sizeOf($("slots"));
  const key = [end, selected, data.run_name, width, height, themeNow()].join();
  if (key === shownSlots) return;
  shownSlots = key;
  const { frame_ms: frameMs, slot_ms: slotMs } = data.timeslots, frames = new Map();
  for (let i = end - 1; i >= 0; i--) {
    const packet = data.packets[i], frame = Math.floor(packet[0] * data.theta / frameMs);
    if (!frames.has(frame) && frames.size === SHOWN_FRAMES) break;
    frames.set(frame, [...(frames.get(frame) || []), packet]);
  }
  $("slots-now").textContent = `frames of ${frameMs / 1000} s, slots of ${slotMs / 1000} s, aMussels' time`;
  const { ctx } = fresh($("slots")), box = { left: 84, right: width - 10, top: 30, bottom: height - 4 };
  const x = (ms) => box.left + (box.right - box.left) * ms / frameMs, wide = x(slotMs) - x(0), tall = (box.bottom - box.top) / SHOWN_FRAMES;
  const ids = Object.keys(data.homes).map(Number).sort((a, b) => a - b), every = Math.ceil(24 / wide);
  ctx.textBaseline = "middle";
  ctx.textAlign = "right";
  ctx.fillStyle = SOFT;
  ctx.fillText("slot", box.left - 6, 8);
  ctx.fillText("aMussel", box.left - 6, 21);
  ctx.textAlign = "center";
  for (let slot = 0; slot * slotMs < frameMs; slot++) {
    const middle = x((slot + 0.5) * slotMs);
    ctx.lineWidth = 1;
    stroke(ctx, LINE, [[x(slot * slotMs), box.top], [x(slot * slotMs), box.bottom]]);
    if (slot % every) continue;
    ctx.fillStyle = SOFT;
    ctx.fillText(slot, middle, 8);
    ctx.fillStyle = INK;
    if (slot < ids.length) ctx.fillText(ids[slot], middle, 21);
  }
  drawnPackets = [];
  [...frames].forEach(([frame, packets], row) => {
    const top = box.top + tall * row;
    ctx.textAlign = "right";
    ctx.fillStyle = SOFT;
    ctx.fillText(clock(frame * frameMs / data.theta), box.left - 6, top + tall / 2);
    for (const packet of packets) {
      drawnPackets.push({ packet, left: x(packet[0] * data.theta - frame * frameMs), top, bottom: top + tall });
      const from = x(packet[0] * data.theta - frame * frameMs), long = Math.max(4, x(packet[1]) - x(0));
      ctx.globalAlpha = isOf(packet, selected) ? 1 : 0.25;
      ctx.fillStyle = fateOf(packet);
      ctx.fillRect(from, top + 2, long, tall - 4);
      // Whoever transmits in another's timeslot is named, and each where there is room.
      if (wide < 24 && ids[packet[8]] === packet[2]) continue;
      ctx.textAlign = "left";
      ctx.fillStyle = INK;
      ctx.fillText(nodeName(packet[2]), from + long + 3, top + tall / 2);
    }
    ctx.globalAlpha = 1;
  });
}

let drawnPackets = [];
function slotWords(x, y) {
  const under = drawnPackets.filter((it) => y >= it.top && y < it.bottom && Math.abs(x - it.left) < 24).sort((a, b) => Math.abs(x - a.left) - Math.abs(x - b.left))[0];
  return under ? `${clock(under.packet[0])}  ${nodeName(under.packet[2])}, slot ${under.packet[8] ?? "none"}: ${words(under.packet[3])}, ${fate(under.packet)}` : "";
}

// The selected aMussel: both batteries, and below them its state, its modules, its log and its packets over time.
function showSelected(view) {
  const agent = data.agents.find((it) => it.id === selected);
  if ($("one-card").hidden !== !agent) $("one-card").hidden = !agent;
  if (!agent) return;
  const now = view.agents.find((it) => it.id === selected);
  const state = now.state === null ? "unknown" : data.states[now.state];
  const secondary = now.secondary === null ? "unknown" : percent(now.secondary);
  const taken = agent.taken && agent.taken[view.i];
  $("one-now").textContent = `${selected}: ${state}; primary ${now.charge === null ? "unknown" : percent(now.charge)}, secondary ${secondary}`
    + (now.heard === null ? "; never heard" : `; heard ${ago(now)}`) + [...ageWords(now), ...suspectWords(now), ...reportedWords(agent, view.i)].map((it) => `; ${it}`).join("")
    + (taken ? `; ${taken} samples taken, ${agent.acknowledged[view.i]} uploaded` : "");
  const times = data.times_ms, key = [times.length, data.packets.length].join(), shape = [data.run_name, selected].join();
  const asPercent = (value) => Math.round(100 * value) + " %";
  drawChart("one", shape, key, () => ({
    min: 0, max: 1, format: asPercent, exact: percent, isAboveRows: true,
    lines: [
      { name: "primary", times, values: agent.charge, stroke: () => colour("above"), width: 2 },
      { name: "secondary", times, values: agent.secondary, stroke: () => colour("charging"), width: 2, dash: [5, 3] },
    ],
  }));
  const rows = rowsOf(agent), high = 28 + 16 * rows.length + "px";
  if ($("one-rows").style.height !== high) { $("one-rows").style.height = high; sizes.delete($("one-rows")); }
  drawChart("one-rows", [shape, rows.map((it) => it.name)].join(), key, () => ({
    min: 0, max: rows.length, rows: rows.map((it) => it.name).reverse(),
    wordsAt: (name, ms) => {
      const span = rows.find((it) => it.name === name).spans.find(([from, to]) => ms >= from && ms <= to);
      return span ? `: ${span[3] || "yes"}` : "";
    }, lines: [{ times, values: times.map(() => null), stroke: LINE, width: 0 }],
    over: (ctx, x, y, pixel) => rows.forEach(({ spans }, n) => drawSpans(ctx, spans, x, y(rows.length - n - 0.1), y(rows.length - n - 0.9), pixel)),
  }));
}

// A chart for each sensor of the aMussels.
function makeMeasured() {
  if ($("measured").children.length) return;
  $("measured").append(...data.sensors.map(([name, unit], n) => {
    const figure = document.createElement("figure");
    figure.innerHTML = `<figcaption><span></span> <output></output></figcaption><div class="chart" id="measured-${n}"></div>`;
    figure.querySelector("span").textContent = `${name[0].toUpperCase()}${words(name.slice(1))}, ${unit}`;
    return figure;
  }));
}

// What aMussels measured and uploaded, and the water's true value while they are in it: of the selected one, or of all in a
// small fleet.
const MOST_MEASURING = 24;
let measured = { key: "", of: [] };
function showMeasured({ i }) {
  const there = data.measured.length > 0, count = $("measured-count");
  if ($("measured-card").hidden === there) $("measured-card").hidden = !there;
  if (!there) return;
  const one = data.agents.find((it) => it.id === selected), shown = one ? [one] : data.agents.length > MOST_MEASURING ? [] : data.agents;
  const key = [data.measured.length, data.measured.at(-1), data.times_ms.length].join(), shape = [data.run_name, selected, shown.some((it) => it.water)].join();
  if (measured.key !== key + shape) {
    measured = { key: key + shape, of: shown.map((agent) => [agent, data.measured.filter((it) => it[1] === agent.id).sort((a, b) => a[0] - b[0])]) };
    $("true-too").hidden = !shown.some((it) => it.water);
  }
  const told = measured.of.flatMap(([, samples]) => samples), newest = told.findLast((it) => it[0] <= nowMs);
  // A sample may come long after it was taken: with the next docking.
  const which = one ? ` of aMussel ${selected}${newest ? `, the newest of ${clock(newest[0])}` : ""}` : "";
  put(count, shown.length ? `${told.length} samples${which}` : "select an aMussel");
  data.sensors.forEach((_, n) => {
    const value = one && newest ? fixed(newest[n + 2], 2) : "", truth = one && one.water && one.water[i] ? `true now ${fixed(one.water[i][n], 2)}` : "";
    put($("measured").children[n].querySelector("output"), [value, truth].filter(Boolean).join(", "));
    drawChart(`measured-${n}`, shape, key, () => measuredChart(n));
  });
}

// The values have the whole height: the truth leaves it on an aMussel's way up and down.
function measuredChart(n) {
  const width = selected === null ? 1 : 1.6;
  const lines = measured.of.flatMap(([agent, samples]) => [
    { name: `aMussel ${agent.id}`, times: samples.map((it) => it[0]), values: samples.map((it) => it[n + 2]), stroke: () => ACCENT, width },
    ...(agent.water ? [{ name: `true at aMussel ${agent.id}`, times: data.times_ms, values: agent.water.map((it) => it && it[n]), stroke: () => PAINT.way, width, dash: [5, 4] }] : []),
  ]);
  const known = measured.of.flatMap(([, samples]) => samples.map((it) => it[n + 2])).filter((it) => it !== null);
  const [least, most] = known.reduce(([low, high], it) => [Math.min(low, it), Math.max(high, it)], known.length ? [Infinity, -Infinity] : [0, 1]);
  const span = most - least || 1, digits = Math.max(0, -Math.floor(Math.log10(niceStep(span / 4))));
  return {
    lines, min: least - 0.1 * span, max: most + 0.1 * span, format: (value) => String(+value.toFixed(digits + 1)), exact: (value) => `${value.toFixed(digits + 1)} ${data.sensors[n][1]}`,
    over: (ctx, x, y, pixel) => {
      ctx.fillStyle = ACCENT;
      for (const [ms, , ...values] of measured.of.flatMap(([, samples]) => samples)) {
        if (values[n] === null) continue;
        ctx.beginPath();
        ctx.arc(x(ms), y(values[n]), 1.8 * pixel, 0, 7);
        ctx.fill();
      }
    },
  };
}

// The newest of the quantities that it reports and nobody estimates.
function reportedWords({ reported }, i) {
  const values = (reported && reported[i]) || [];
  return values.flatMap((value, n) => (value === null ? [] : [`${data.quantities[n][1]} ${+value.toFixed(2)} ${data.quantities[n][2]}`.trim()]));
}

// Each span is [from ms, to ms, colour, words]; one of no length is drawn as a line.
function drawSpans(ctx, spans, x, top, bottom, pixel) {
  ctx.font = `${11 * pixel}px system-ui, 'DejaVu Sans', sans-serif`;
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  for (const [from, to, style, name] of spans) {
    const left = x(from), wide = Math.max(1.5 * pixel, x(to) - left);
    ctx.fillStyle = style;
    ctx.fillRect(left, top, wide, bottom - top);
    if (!name || ctx.measureText(name).width > wide - 4) continue;
    ctx.fillStyle = "#000";
    ctx.fillText(name, left + wide / 2, (top + bottom) / 2);
  }
}

let kept = { key: "" };
function rowsOf(agent) {
  const key = [data.run_name, agent.id, data.times_ms.length, data.packets.length, themeNow()].join();
  if (kept.key === key) return kept.rows;
  const times = data.times_ms, own = data.packets.filter((it) => isOf(it, agent.id));
  const mark = (packet, outcome) => [packet[0], packet[0] + packet[1] / data.theta, fateColour(packet[5] === null ? outcome : "unsent")];
  const sent = own.filter((it) => it[2] === agent.id).map((it) => mark(it, (it[6].find(([, outcome]) => outcome === "received") || it[6][0] || [])[1]));
  const heard = own.filter((it) => it[2] !== agent.id).map((it) => mark(it, (it[6].find(([id]) => id === agent.id) || [])[1]));
  const modules = data.rails.map((name, n) => ({ name, spans: agent.rails ? columnSpans(times, agent.rails, (it) => (it >> n) & 1, true).map(([from, to]) => [from, to, ACCENT]) : [] }));
  const steps = (column, style) => (column || []).flatMap((value, i) => (i && value > (column[i - 1] || 0) ? [[times[i], times[i], style]] : []));
  const rows = [
    { name: "state", spans: columnSpans(times, agent.state, (it) => it, false).map(([from, to, it]) => [from, to, `hsl(${(it * 137) % 360} 55% 62%)`, data.states[it]]) },
    ...modules,
    { name: "sampled", spans: steps(agent.taken, colour("above")) },
    { name: "uploaded", spans: steps(agent.acknowledged, PAINT.received) },
    { name: "sent", spans: sent },
    { name: "heard", spans: heard },
  ].filter((it) => it.spans.length);
  kept = { key, rows };
  return rows;
}

// The spans of a column's equal values that are not 0 or null; `back`: a value holds for the time since the sample before.
function columnSpans(times, column, of, back) {
  const spans = [];
  for (let i = 0; i < column.length;) {
    const value = of(column[i]);
    let end = i;
    while (end + 1 < column.length && of(column[end + 1]) === value) end++;
    const from = back ? Math.max(0, i - 1) : i, to = back ? end : Math.min(end + 1, column.length - 1);
    if (column[i] !== null && (value || !back)) spans.push([times[from], times[to], value]);
    i = end + 1;
  }
  return spans;
}

// What differs between two runs: figures at the time shown and at the end, and settings.
function showDifferences(views) {
  if (!runs[0].differs) return;
  const mean = (list) => list.reduce((a, b) => a + b, 0) / (list.length || 1);
  const digits = (value) => (value === null || value === undefined ? "" : typeof value === "number" ? String(+value.toFixed(2)) : String(value));
  const row = ([name, ...values]) => {
    const [a, b] = values, change = typeof a === "number" && typeof b === "number" ? b - a : null;
    return [name, digits(a), digits(b), change === null ? "" : (change > 0 ? "+" : "") + digits(change)];
  };
  const now = [
    ["active", ...views.map((it) => it.active)],
    ["mean charge, %", ...views.map((it) => 100 * mean(it.agents.map((one) => one.charge).filter((one) => one !== null)))],
    ["mean uptime so far, %", ...views.map((it) => mean(it.agents.map((one) => one.uptime)))],
    ["way flown, m", ...views.map((it) => it.cost)],
    ["aPad battery, %", ...views.map((it) => it.apad && it.apad.battery !== null ? 100 * it.apad.battery : null)],
  ];
  const [first, second] = runs.map((it) => it.summary || {});
  const whole = Object.keys({ ...first, ...second }).filter((it) => !["name", "run", "amussels", "events"].includes(it))
    .map((it) => [words(it), ...[first, second].map((of) => (of[it] && of[it].mean !== undefined ? of[it].mean : of[it]))])
    .filter(([, a, b]) => (typeof a === "number" || typeof b === "number" || typeof a === "string") && a !== b);
  const parts = [[`At ${clock(nowMs)}`, now.map(row)], ["At the end, where they differ", whole.map(row)], ["Settings that differ", runs[0].differs.map((it) => [...it, ""])]];
  $("differences").replaceChildren(...parts.flatMap(([title, rows]) => [[title, ...runs.map((it) => it.run_name), "change"], ...rows].map((cells, n) => {
    const line = document.createElement("tr");
    line.append(...cells.map((it) => Object.assign(document.createElement(n ? "td" : "th"), { textContent: it })));
    return line;
  })));
}
