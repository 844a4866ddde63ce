// Follows a run that flies: takes what the console sends, and sends a person's orders. Nothing of it runs in a replay.

// The console sends something at least each second; the page looks twice a second, and so says within 3 s that it is silent.
const SILENT_MS = 2500;
const LEGEND_MS = 3000;
const SHARED_COLUMNS = ["times_ms", "active", "cost", "apad", "docks", "stage"];
let counts, heardMs, stream, token, legendMs = 0;

function take({ sample, supervisor, ended_by, summary, speed }) {
  heardMs = performance.now();
  const hasEnded = ended_by !== data.ended_by || (summary !== null && data.summary === null);
  Object.assign(data, { ended_by, summary });
  if (hasEnded || speed !== data.live.speed) {
    data.live.speed = speed;
    showHeader();
    showSpeed();
  }
  if (sample) takeSample(sample);
  showLink(supervisor);
}

function takeSample(sample) {
  counts = sample.counts;
  // Lines may follow in the tick of the newest sample, as the run's end does: the sample is sent again, and replaces it.
  if (sample.t === data.times_ms[data.times_ms.length - 1]) dropNewest();
  else if (data.times_ms.length >= data.live.most_samples) thin();
  append(sample);
  for (const name of ["trace", "plans", "packets", "measured"]) data[name].push(...sample[name]);
  data.measured.splice(0, data.measured.length - data.live.most_measured);
  data.suspects = sample.suspects;
  if (performance.now() - legendMs > LEGEND_MS) { legendMs = performance.now(); showLegend(); }
  const surplus = data.packets.length - data.live.most_packets;
  if (surplus > 0) { data.packets.splice(0, surplus); data.earlier_packets += surplus; }
  if (sample.packets.length) showPacketCards();
  if (sample.events.length) {
    data.events.push(...sample.events);
    addEvents(sample.events);
  }
  endMs = data.times_ms[data.times_ms.length - 1];
  $("scrub").max = endMs / 1000;
  if (document.body.classList.contains("following")) show(endMs);
}

function append(sample) {
  const length = data.times_ms.push(sample.t);
  data.has_truth = sample.has_truth;
  data.agents.forEach((agent, n) => data.live.columns.forEach((name, k) => {
    const value = sample.agents[n][k];
    // A column that had no value so far is null as a whole.
    if (agent[name] === null && value !== null) agent[name] = Array(length - 1).fill(null);
    if (agent[name] !== null) agent[name].push(value);
  }));
  for (const name of ["active", "cost", "apad", "docks"]) data[name].push(sample[name]);
  const last = data.stages[data.stages.length - 1];
  if (JSON.stringify(last) !== JSON.stringify(sample.stage)) data.stages.push(sample.stage);
  data.stage.push(data.stages.length - 1);
}

function dropNewest() {
  for (const agent of data.agents) for (const name of data.live.columns) if (agent[name] !== null) agent[name].pop();
  for (const name of SHARED_COLUMNS) data[name].pop();
}

// Drops every second sample, and never the newest.
function thin() {
  const halve = (list) => list && list.filter((_, i) => (list.length - 1 - i) % 2 === 0);
  for (const agent of data.agents) for (const name of data.live.columns) agent[name] = halve(agent[name]);
  for (const name of SHARED_COLUMNS) data[name] = halve(data[name]);
}

// Says what a person cannot rely on: a page without a console, a run without a supervisor.
function showLink(supervisor) {
  const silent = performance.now() - heardMs > SILENT_MS;
  let words = "";
  if (data.ended_by !== null) words = `The run has ended: ${data.ended_by}. No order of this page reaches the aPad now. Replay: ${data.live.replay}`;
  else if (silent) words = "The console does not answer: what is shown is old.";
  else if (!supervisor) words = "No supervisor takes orders: it died, or the run flies in virtual time.";
  $("warning").textContent = words;
  $("warning").hidden = words === "";
  $("follow").hidden = data.ended_by !== null;
  document.body.classList.toggle("over", data.ended_by !== null);
  const takesOrders = supervisor && !silent && data.ended_by === null;
  for (const button of document.querySelectorAll(".order, #one-orders button")) button.disabled = !takesOrders;
  showStopLive(words);
}

// No order takes the place of another. The one that stands is shown pressed; a stop that failed may be ordered again.
function showStopLive(unheard) {
  const stage = data.stages[data.stages.length - 1], stopped = Boolean(stage.stop) && !hasFailed(stage.stop);
  document.body.classList.toggle("stopped", stopped);
  $("stop").disabled ||= stopped;
  $("continue").disabled ||= !stage.stop;
  $("give-back").disabled ||= !stage.stop && !stage.interrupted;
  const pressed = stopped ? stage.stop.mode : null, under = pressed && ["ordered", "sent"].includes(lastState(stage.stop));
  put($("stop"), pressed === "hold" ? (under ? "Stopping" : "Stopped") : "Stop: hold here");
  $("off").setAttribute("aria-pressed", String(pressed === "off"));
  const state = stage.refused || (stage.stop && !stopped) ? "STOP FAILED: " : stopped ? (stage.stop.mode === "off" ? "OFF: " : "STOPPED: ") : "";
  document.title = `${state}${data.name} - live`;
  soundAlarm(stage, unheard);
}

async function order(act, more = {}, asks = "") {
  const whose = more.agent === undefined ? "" : ` (aMussel ${more.agent})`;
  if (asks && !(await isSure(asks + whose))) return;
  $("answer").textContent = "…";
  try {
    const answer = await fetch("/orders", {
      method: "POST", headers: { "X-Musselbed-Token": token }, body: JSON.stringify({ act, by: "console", ...more }),
    });
    const { accepted, message, state, after_s: after, steers } = await answer.json();
    const done = state ? `${state}${state in after ? ` after ${after[state].toFixed(1)} s` : ""}` : accepted ? "done" : "refused";
    $("answer").textContent = `${act}${whose}: ${message || done}${steers ? `; ${steers}` : ""}`;
  } catch {
    $("answer").textContent = `${act}: the console does not answer`;
  }
}

// Takes the answer where it is given: the dialog's "close" comes a task later, when the next question may stand already.
function isSure(question) {
  $("sure").firstChild.textContent = question;
  $("sure").showModal();
  return new Promise((done) => {
    $("sure").lastChild.onsubmit = (event) => done(event.submitter.value === "yes");
    $("sure").oncancel = () => done(false);
  });
}

// The flight's own speed, where a person may change it.
function showSpeed() {
  const { speed } = data.live, known = [0, 1, 2, 5, 10, 20, 60, 120];
  $("flight-speed").hidden = speed === null;
  $("step").hidden = speed !== 0;
  if (speed === null) return;
  const all = [...new Set([...known, speed])].sort((a, b) => a - b);
  $("flight-speed").replaceChildren(...all.map((it) => new Option(it ? `Speed ${it} ×` : "Time stands still", it, false, it === speed)));
}

function connect() {
  stream = new EventSource(`/live?token=${encodeURIComponent(token)}&counts=${counts.join()}`);
  stream.onmessage = (event) => take(JSON.parse(event.data));
  // Not the browser's own reconnection, which would ask again for what the page has by now.
  stream.onerror = () => {
    stream.close();
    // The summary comes after the end: a page that is too slow for the stream may lose it in between.
    if (data.summary === null) setTimeout(connect, 1000);
  };
}

function follow() {
  play(false);
  document.body.classList.add("following");
  show(endMs);
}

// The token stays with this tab and this origin: a cookie would go to every port of the host.
function takeToken() {
  token = new URLSearchParams(location.search).get("token");
  sessionStorage.setItem("token", token);
  history.replaceState(null, "", "/" + location.hash);
}

if (data.live) {
  takeToken();
  document.body.classList.add("live");
  counts = data.live.counts;
  heardMs = performance.now();
  for (const it of [...document.querySelectorAll(".orders"), $("one-orders")]) it.hidden = false;
  const { ping, faults } = data.live.orders;
  $("fault").replaceChildren(...faults.map((it) => new Option(words(it.fault), it.fault)));
  const rowOfFault = () => faults.find((it) => it.fault === $("fault").value);
  const showFault = () => {
    const row = rowOfFault();
    if (!row) return;
    $("fault").title = row.does;
    $("fault-value-of").hidden = !row.parameter;
    $("fault-for-of").hidden = !row.span_s;
    $("fault-for").value = row.span_s;
    if (!row.parameter) return;
    $("fault-unit").textContent = `${row.parameter.name} (${row.parameter.unit})`;
    Object.assign($("fault-value"), { value: row.parameter.default, min: row.parameter.least, max: row.parameter.most });
  };
  const chosenFault = () => {
    const row = rowOfFault();
    return {
      fault: row.fault,
      ...(row.parameter ? { value: $("fault-value").valueAsNumber } : {}),
      ...(row.span_s ? { for_s: $("fault-for").valueAsNumber } : {}),
    };
  };
  $("fault").addEventListener("change", showFault);
  showFault();
  for (const button of $("one-orders").querySelectorAll("button")) {
    const { act, asks } = button.dataset;
    button.hidden = (act === "ping" && !ping) || (act === "cause a fault" && !faults.length);
    button.addEventListener("click", () => order(act, { agent: selected, ...(act === "cause a fault" ? chosenFault() : {}) }, asks));
  }
  $("fault").hidden = !faults.length;
  for (const button of document.querySelectorAll(".orders [data-act]")) {
    const { act, sends, asks, names } = button.dataset;
    button.addEventListener("click", () => {
      const { stop } = names ? data.stages[data.stages.length - 1] : {};
      order(act, { ...JSON.parse(sends), ...(stop && stop.number !== null ? { stop: stop.number } : {}) }, asks);
    });
  }
  $("flight-speed").onchange = () => order("speed", { times: +$("flight-speed").value });
  $("step").addEventListener("click", () => order("speed"));
  showSpeed();
  $("heard").addEventListener("click", calm);
  for (const touch of ["pointerdown", "keydown"]) document.addEventListener(touch, prepareSound, { once: true });
  $("sound").addEventListener("click", () => {
    isMuted = Boolean(sound) && sound.state === "running" && $("sound").getAttribute("aria-pressed") === "true";
    prepareSound();
  });
  $("remark").addEventListener("submit", (event) => {
    event.preventDefault();
    const text = $("remark-text").value.trim();
    if (text) order("remark", { text }).then(() => { $("remark-text").value = ""; });
  });
  $("follow").addEventListener("click", follow);
  setInterval(() => { if (performance.now() - heardMs > SILENT_MS) showLink(false); }, 500);
  showLink(data.live.supervisor);
  if (!location.hash) follow();
  connect();
}
