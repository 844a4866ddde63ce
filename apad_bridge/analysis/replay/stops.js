// A stop on the page: what is stopped, by whom, how far the stop has come, and where an aPad without thrust drifts. Live, a
// stop by a guard, one that the vehicle does not take, and a drift sound an alarm.

const STOP_STATES = { ordered: "ordered", sent: "sent", taken: "taken by the vehicle", obeyed: "the hull slows", "not obeyed": "NOT OBEYED", "at rest": "at rest", "not taken": "NOT TAKEN" };
const POINTS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];

const lastState = (stop) => stop.states[stop.states.length - 1][0];
// A stop that a person has to carry out by hand.
const hasFailed = (stop) => ["not taken", "not obeyed"].includes(lastState(stop));
const isGuards = (stop) => stop.by.startsWith("guard");

// The heading of the banner; empty where nothing is stopped.
function stopWords({ stop, refused }) {
  if (refused) return `STOP REFUSED: ${refused.reason || "the vehicle is not ours to stop"}`;
  if (!stop) return "";
  if (lastState(stop) === "not obeyed") return "THE APAD DOES NOT OBEY: cut its power by hand";
  if (hasFailed(stop)) return "STOP NOT TAKEN by the vehicle: use the joystick or its switch";
  return stop.mode === "off" ? "MOTORS OFF: the aPad has no thrust" : "STOPPED: the aPad holds its place";
}

function statesWords(stop) {
  const number = stop.number === null ? "" : `Stop ${stop.number} `;
  const states = stop.states.map(([state, ms]) => `${STOP_STATES[state] || state} ${clock(ms)}`);
  const stands = data.live && data.live.stands && !isGuards(stop) && (stop.mode === "off" ? ["obeyed", "at rest"] : ["at rest"]).includes(lastState(stop));
  return `${number}by ${stop.by}: ${states.join(", ")}${stop.reason ? ` (${stop.reason})` : ""}${stands ? "; mission time waits for you" : ""}`;
}

// Less rounds to 0.00 m/s: the hull lies still without thrust.
const moves = (drift) => Boolean(drift) && drift.speed_m_s >= 0.005;

function driftWords({ speed_m_s: speed, towards_rad: towards, fence_s: fence, north_m: north, east_m: east, t }) {
  const degrees = (Math.round(towards * 180 / Math.PI) + 360) % 360;
  const place = north === undefined ? "" : `, at ${north.toFixed(1)} m north, ${east.toFixed(1)} m east`;
  const reaches = fence === null ? "" : `; at the fence in ${fence < 90 ? `${Math.round(fence)} s` : `${Math.round(fence / 60)} min`}`;
  return `Drifts ${speed.toFixed(2)} m/s to the ${POINTS[Math.round(degrees / 45) % 8]} (${degrees}°)${place}${reaches} (${clock(t)})`;
}

function showStop({ stage }) {
  const { stop, drift, refused } = stage, heading = stopWords(stage);
  const kind = heading === "" ? "" : refused || hasFailed(stop) ? "failed" : stop.mode;
  if (document.body.dataset.stop !== kind) document.body.dataset.stop = kind;
  if ($("stopped").hidden !== (heading === "")) $("stopped").hidden = heading === "";
  put($("stopped-what"), heading);
  put($("stopped-states"), stop ? statesWords(stop) : "");
  put($("drift"), moves(drift) ? driftWords(drift) : drift ? `No drift is seen (${clock(drift.t)})` : "");
  put($("plan-stopped"), stop ? "stopped" : "");
}

// The times in which a person or a guard kept the mission from the aPad, for the charts: [from ms, to ms].
function interruptedSpans(run) {
  return columnSpans(run.times_ms, run.stage, (it) => Number(Boolean(run.stages[it] && run.stages[it].interrupted)), true).map(([from, to]) => [from, to]);
}

// The alarm. A browser plays no sound before a person has touched the page, so the first touch prepares it.
let sound = null, isMuted = false, alarmed = "", beeping = null;
const calmed = new Set();

function prepareSound() {
  if (!sound) {
    const Audio = window.AudioContext || window.webkitAudioContext;
    if (!Audio) return;
    sound = new Audio();
  }
  sound.resume().then(showSound);
}

function showSound() {
  const on = Boolean(sound) && sound.state === "running" && !isMuted;
  $("sound").setAttribute("aria-pressed", String(on));
  put($("sound"), on ? "Sound on" : "Sound off: tap");
}

// Two rising tones of a quarter of a second each.
function beep() {
  if (navigator.vibrate && navigator.userActivation && navigator.userActivation.hasBeenActive) navigator.vibrate([250, 100, 250]);
  document.body.dataset.beeps = Number(document.body.dataset.beeps || 0) + 1;
  if (!sound || sound.state !== "running" || isMuted) return;
  [660, 880].forEach((hertz, n) => {
    const tone = sound.createOscillator(), loud = sound.createGain(), from = sound.currentTime + 0.3 * n;
    tone.type = "square";
    tone.frequency.value = hertz;
    loud.gain.setValueAtTime(0.25, from);
    loud.gain.setValueAtTime(0, from + 0.25);
    tone.connect(loud).connect(sound.destination);
    tone.start(from);
    tone.stop(from + 0.26);
  });
}

// What a person is to hear now; each one sounds until it is over, or somebody says that it was heard.
function alarmOf({ stop, drift, refused }, unheard) {
  if (refused) return `refused ${refused.number}`;
  if (stop && hasFailed(stop)) return `${lastState(stop)} ${stop.number}`;
  if (moves(drift)) return `drift ${drift.t}`;
  if (stop && isGuards(stop)) return `guard ${stop.number}`;
  return unheard;
}

function soundAlarm(stage, unheard) {
  alarmed = alarmOf(stage, unheard);
  if (alarmed === "") calmed.clear();  // the same cause is news when it comes again
  const rings = alarmed !== "" && !calmed.has(alarmed);
  if ($("heard").hidden === rings) $("heard").hidden = !rings;
  if (rings && beeping === null) {
    beep();
    beeping = setInterval(beep, 2000);
  } else if (!rings && beeping !== null) {
    clearInterval(beeping);
    beeping = null;
  }
}

function calm() {
  const stage = data.stages[data.stages.length - 1];
  calmed.add(alarmed);
  if (stage.stop) calmed.add(`guard ${stage.stop.number}`);  // it was heard with its drift
  soundAlarm(stage, alarmed);
}
