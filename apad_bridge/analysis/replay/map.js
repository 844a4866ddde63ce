// The map: local NED metres, north up, one scale both ways. A `view` is a run at one time, from page.js.

const RECENT_MS = 300000;
const PACKET_MS = 10000;
const FATES = { received: "received", collided: "collided", transmitting: "half-duplex" };
const fateColour = (outcome) => PAINT[FATES[outcome] || "missed"];

// Draws each run of a flight, the chosen one last. What does not move is kept as a picture, and the tracks so far as another.
function drawMap(canvas, runs, views, marked, packets) {
  const { ctx, width, height } = fresh(canvas);
  if (!width) return;
  const toScreen = mapScale(width, height);
  const at = ([north, east]) => [toScreen.x(east), toScreen.y(north)];
  const key = [...runs.map((it) => it.run_name), boundsOf().join(), themeNow()].join();
  const still = picture(canvas, key, (inner) => {
    drawGrid(inner, toScreen, width, height);
    drawPlace(inner, runs[runs.length - 1], at);
    for (const run of runs) drawHomes(inner, run, at);
    drawScaleBar(inner, toScreen.perMetre, width);
  });
  ctx.drawImage(still, 0, 0, width, height);
  runs.forEach((run, n) => drawTrack(ctx, canvas, key, run, views[n].nowMs, at));
  // Below the aMussels, whose numbers stay readable where a packet begins and ends.
  drawPackets(ctx, packets, runs, views, at);
  // Hulls are drawn larger than they are: an aMussel in the water near one stays in sight.
  for (const view of views) if (view.apad) drawHull(ctx, at(view.apad.place), view);
  runs.forEach((run, n) => drawRun(ctx, views[n], at, marked));
  runs.forEach((run, n) => { if (views[n].apad) drawDocks(ctx, at(views[n].apad.place), run, views[n], marked); });
}

// The area, its shore and depths, and the fence with its keep-out zones.
function drawPlace(ctx, data, at) {
  const path = (points, closed) => {
    ctx.beginPath();
    points.map(at).forEach(([x, y], i) => (i ? ctx.lineTo(x, y) : ctx.moveTo(x, y)));
    if (closed) ctx.closePath();
  };
  path(data.polygon, true);
  ctx.fillStyle = PAINT.water;
  ctx.fill();
  ctx.lineWidth = data.chart.length ? 0.5 : 1.5;
  ctx.strokeStyle = PAINT.shore;
  ctx.stroke();
  ctx.textAlign = "left";
  for (const { depth, points } of data.chart) {
    path(points, false);
    ctx.lineWidth = depth === null ? 2.5 : 1;
    ctx.strokeStyle = depth === null ? PAINT.shore : PAINT.contour;
    ctx.stroke();
    if (depth === null) continue;
    const [x, y] = at(points[Math.floor(points.length / 2)]);
    ctx.fillStyle = SOFT;
    ctx.fillText(depth + " m", x + 3, y - 3);
  }
  ctx.setLineDash([8, 5]);
  ctx.lineWidth = 1.5;
  ctx.strokeStyle = PAINT.fence;
  for (const zone of data.fence ? [data.fence, ...data.keep_out] : []) { path(zone, true); ctx.stroke(); }
  ctx.setLineDash([]);
  ctx.globalAlpha = 0.25;
  ctx.fillStyle = PAINT.fence;
  for (const zone of data.keep_out) { path(zone, true); ctx.fill(); }
  ctx.globalAlpha = 1;
}

function drawHomes(ctx, data, at) {
  ctx.strokeStyle = PAINT.home;
  ctx.lineWidth = 1;
  for (const agent of data.agents) {
    const home = data.homes[agent.id];
    if (!home) continue;
    ctx.beginPath();
    ctx.arc(...at(home), 8, 0, 7);
    ctx.stroke();
  }
}

function drawRun(ctx, view, at, marked) {
  drawWay(ctx, view, at);
  for (const agent of view.agents) {
    if (agent.dock !== null || agent.place === null) continue;
    drawMussel(ctx, at(agent.place), 9, agent, marked);
  }
}

// The aMussel that is drawn nearest to a point of the map, or null when none is near.
function musselAt(views, { width, height }, x, y) {
  const toScreen = mapScale(width, height);
  let found = null, nearest = 18;
  for (const view of views) {
    for (const { id, place, dock } of view.agents) {
      if (place === null || dock !== null) continue;
      const away = Math.hypot(toScreen.x(place[1]) - x, toScreen.y(place[0]) - y);
      if (away < nearest) [found, nearest] = [id, away];
    }
  }
  return found;
}

// Each packet as lines from its sender to its listeners, in the colour of what became of it there; older ones fade.
function drawPackets(ctx, packets, runs, views, at) {
  const places = new Map();
  for (const view of views) for (const agent of view.agents) if (agent.place) places.set(agent.id, agent.place);
  for (const { run, packet: [, , sender, , , unsent, heard], age } of packets) {
    const own = views[runs.indexOf(run)].apad; // in a run's packets its own aPad is 0
    if (own) places.set(0, own.place);
    else places.delete(0);
    if (unsent !== null || !places.has(sender)) continue;
    ctx.globalAlpha = 1 - 0.8 * age;
    for (const [listener, outcome] of heard) {
      if (!places.has(listener)) continue;
      const [from, to] = [at(places.get(sender)), at(places.get(listener))];
      const missed = outcome !== "received";
      ctx.setLineDash(missed ? [3, 4] : []);
      ctx.lineWidth = missed ? 1.5 : 2.5;
      stroke(ctx, fateColour(outcome), [from, to]);
      ctx.setLineDash([]);
      if (missed) drawCross(ctx, to, fateColour(outcome));
    }
    ctx.lineWidth = 2;
    ctx.strokeStyle = PAINT.received;
    ctx.beginPath();
    ctx.arc(...at(places.get(sender)), 13 + 20 * age, 0, 7);
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
}

function drawCross(ctx, [x, y], style) {
  ctx.lineWidth = 2.5;
  stroke(ctx, style, [[x - 5, y - 16], [x + 5, y - 6]]);
  stroke(ctx, style, [[x - 5, y - 6], [x + 5, y - 16]]);
}

// South, north, west and east of all runs, computed anew when a track has grown.
let bounds = { key: "" };
function boundsOf() {
  const key = runs.map((it) => it.trace.length).join();
  if (bounds.key === key) return bounds.of;
  const of = [Infinity, -Infinity, Infinity, -Infinity];
  const take = (n, e) => { of[0] = Math.min(of[0], n); of[1] = Math.max(of[1], n); of[2] = Math.min(of[2], e); of[3] = Math.max(of[3], e); };
  for (const run of runs) {
    for (const [n, e] of [...run.polygon, ...(run.fence || []), ...[].concat(...run.chart.map((it) => it.points)), ...Object.values(run.homes)]) take(n, e);
    for (const [, n, e] of run.trace) take(n, e);
  }
  bounds = { key, of };
  return of;
}

function mapScale(width, height) {
  const [south, north, west, east] = boundsOf();
  const perMetre = Math.min((width - 90) / Math.max(east - west, 1), (height - 70) / Math.max(north - south, 1));
  return {
    perMetre,
    x: (e) => width / 2 + (e - (west + east) / 2) * perMetre,
    y: (n) => height / 2 - (n - (south + north) / 2) * perMetre,
  };
}

function drawGrid(ctx, toScreen, width, height) {
  const step = niceStep(70 / toScreen.perMetre);
  const east0 = -toScreen.x(0) / toScreen.perMetre, north0 = (toScreen.y(0) - height) / toScreen.perMetre;
  ctx.lineWidth = 1;
  ctx.fillStyle = SOFT;
  ctx.textBaseline = "middle";
  for (let e = Math.ceil(east0 / step) * step; toScreen.x(e) < width; e += step) {
    stroke(ctx, PAINT.grid, [[toScreen.x(e), 0], [toScreen.x(e), height]]);
    ctx.textAlign = "center";
    const half = ctx.measureText(+e.toFixed(3)).width / 2;
    if (toScreen.x(e) - half > 1 && toScreen.x(e) + half < width - 1) ctx.fillText(+e.toFixed(3), toScreen.x(e), height - 7);
  }
  for (let n = Math.ceil(north0 / step) * step; toScreen.y(n) > 0; n += step) {
    stroke(ctx, PAINT.grid, [[0, toScreen.y(n)], [width, toScreen.y(n)]]);
    ctx.textAlign = "left";
    if (toScreen.y(n) < height - 18 && toScreen.y(n) > 26) ctx.fillText(+n.toFixed(3), 3, toScreen.y(n) - 7);
  }
  ctx.textAlign = "right";
  ctx.fillText("east, m", width - 4, height - 21);
  ctx.textAlign = "left";
  ctx.fillText("north, m", 3, 8);
}

// The aPad's whole track so far, pale; its last five minutes, clear. The pale one grows on a picture of its own.
const tracks = new Map();
function drawTrack(ctx, canvas, key, run, nowMs, at) {
  const { trace } = run, end = firstAfter(trace, nowMs), recent = firstAfter(trace, nowMs - RECENT_MS);
  const whole = [key, canvas.width, canvas.height].join(), ratio = window.devicePixelRatio || 1, of = canvas.id + run.run_name;
  let kept = tracks.get(of);
  if (!kept) tracks.set(of, kept = { own: document.createElement("canvas") });
  if (kept.whole !== whole || kept.trace !== trace || kept.drawn > end) {
    Object.assign(kept.own, { width: canvas.width, height: canvas.height });
    Object.assign(kept, { whole, trace, drawn: 0 });
  }
  if (end > kept.drawn) {
    const inner = kept.own.getContext("2d");
    inner.setTransform(ratio, 0, 0, ratio, 0, 0);
    inner.lineWidth = 1.5;
    stroke(inner, PAINT.track, trace.slice(Math.max(0, kept.drawn - 1), end).map(([, n, e]) => at([n, e])));
    kept.drawn = end;
  }
  ctx.globalAlpha = 0.5;
  ctx.drawImage(kept.own, 0, 0, canvas.width / ratio, canvas.height / ratio);
  ctx.globalAlpha = 1;
  ctx.lineWidth = 2;
  stroke(ctx, PAINT.track, trace.slice(recent, end).map(([, n, e]) => at([n, e])));
}

// The index of the first row, by its time in the first column, that is later than a time.
function firstAfter(rows, ms) {
  let low = 0, high = rows.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rows[middle][0] <= ms) low = middle + 1; else high = middle;
  }
  return low;
}

function drawWay(ctx, view, at) {
  if (!view.apad || view.way.length === 0) return;
  ctx.setLineDash([4, 5]);
  ctx.lineWidth = 1.5;
  stroke(ctx, view.stage.stop ? PAINT.missed : PAINT.way, [view.apad.place, ...view.way].map(at));
  ctx.setLineDash([]);
}

function drawMussel(ctx, [x, y], radius, agent, marked) {
  ctx.beginPath();
  ctx.arc(x, y, radius, 0, 7);
  // An empty one is hollow.
  const isEmpty = STATUSES[agent.status] === "empty", outline = isEmpty ? STATUS_COLOURS[agent.status] : PAINT.card;
  ctx.fillStyle = isEmpty ? PAINT.card : STATUS_COLOURS[agent.status];
  ctx.fill();
  const ink = inkOn(ctx);
  ctx.lineWidth = marked === agent.id ? 3 : isEmpty ? 2.5 : 1.5;
  ctx.strokeStyle = marked === agent.id ? INK : outline;
  ctx.stroke();
  if (agent.suspicion) {
    ctx.setLineDash([4, 3]);
    ctx.strokeStyle = PAINT.bad;
    ctx.lineWidth = 2;
    ctx.beginPath();
    ctx.arc(x, y, radius + 5, 0, 7);
    ctx.stroke();
    ctx.setLineDash([]);
  }
  ctx.fillStyle = ink;
  ctx.font = "bold 10px system-ui, 'DejaVu Sans', sans-serif";
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.fillText(agent.id, x, y + 0.5);
  ctx.font = FONT;
}

// The aPad's hull with its bow, larger than in reality.
function drawHull(ctx, [x, y], view) {
  if (view.stage.stop) drawStopped(ctx, [x, y], view.stage);
  ctx.save();
  ctx.translate(x, y);
  ctx.rotate(view.apad.heading);
  ctx.fillStyle = PAINT.hull;
  ctx.strokeStyle = PAINT["hull-line"];
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  ctx.moveTo(0, -22);
  ctx.lineTo(10, -12);
  ctx.lineTo(10, 12);
  ctx.lineTo(-10, 12);
  ctx.lineTo(-10, -12);
  ctx.closePath();
  ctx.fill();
  ctx.stroke();
  ctx.restore();
}

function drawDocks(ctx, [x, y], data, view, marked) {
  // Full docks side by side have 17 pixels each.
  const ring = Math.max(19, 17 * data.dock_bearings.length / (2 * Math.PI));
  data.dock_bearings.forEach((bearing, dock) => {
    const angle = (data.docks_turn ? view.apad.heading : 0) + bearing;
    const place = [x + ring * Math.sin(angle), y - ring * Math.cos(angle)];
    const agent = view.agents.find((it) => it.dock === dock);
    if (agent) { drawMussel(ctx, place, 8, agent, marked); return; }
    ctx.beginPath();
    ctx.arc(...place, 5, 0, 7);
    ctx.fillStyle = PAINT.card;
    ctx.fill();
    ctx.lineWidth = 1.5;
    ctx.strokeStyle = PAINT["hull-line"];
    ctx.stroke();
  });
}

// A ring around an aPad that is stopped; without thrust also the way that it drifts, a minute of it.
function drawStopped(ctx, [x, y], { stop, drift }) {
  ctx.lineWidth = 3;
  ctx.strokeStyle = stop.mode === "off" ? PAINT.fence : PAINT.missed;
  ctx.beginPath();
  ctx.arc(x, y, 34, 0, 7);
  ctx.stroke();
  if (!moves(drift)) return;
  const { perMetre } = mapScale(sizeOf(ctx.canvas).width, sizeOf(ctx.canvas).height), long = Math.min(110, Math.max(26, 60 * drift.speed_m_s * perMetre));
  const [dx, dy] = [Math.sin(drift.towards_rad), -Math.cos(drift.towards_rad)], tip = [x + dx * (34 + long), y + dy * (34 + long)];
  stroke(ctx, PAINT.fence, [[x + dx * 34, y + dy * 34], tip]);
  stroke(ctx, PAINT.fence, [[tip[0] - 9 * dx - 6 * dy, tip[1] - 9 * dy + 6 * dx], tip, [tip[0] - 9 * dx + 6 * dy, tip[1] - 9 * dy - 6 * dx]]);
}

function drawScaleBar(ctx, perMetre, width) {
  const metres = niceStep(80 / perMetre), long = metres * perMetre;
  const right = width - 16, y = 22;
  ctx.lineWidth = 2;
  stroke(ctx, INK, [[right - long, y - 4], [right - long, y], [right, y], [right, y - 4]]);
  ctx.fillStyle = INK;
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.fillText(metres + " m", right - long / 2, y - 9);
  ctx.beginPath();
  ctx.moveTo(right, y + 12);
  ctx.lineTo(right - 6, y + 30);
  ctx.lineTo(right, y + 26);
  ctx.lineTo(right + 6, y + 30);
  ctx.closePath();
  ctx.fill();
  ctx.fillText("N", right, y + 38);
}
