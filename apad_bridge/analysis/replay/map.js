// The map: local NED metres, north up, one scale both ways. `view` is the run at one time, from page.js.

const RECENT_MS = 300000;

function drawMap(canvas, data, view, marked) {
  const { ctx, width, height } = fresh(canvas);
  const toScreen = mapScale(data, width, height);
  const at = ([north, east]) => [toScreen.x(east), toScreen.y(north)];
  drawGrid(ctx, toScreen, width, height);
  ctx.beginPath();
  data.polygon.map(at).forEach(([x, y], i) => (i ? ctx.lineTo(x, y) : ctx.moveTo(x, y)));
  ctx.closePath();
  ctx.fillStyle = "#d9ecf766";
  ctx.fill();
  ctx.lineWidth = 1.5;
  ctx.strokeStyle = "#7fb2d3";
  ctx.stroke();
  drawTrace(ctx, data.trace, view.nowMs, at);
  for (const agent of view.agents) {
    const home = data.homes[agent.id];
    if (!home) continue;
    ctx.strokeStyle = "#9aa7b4";
    ctx.lineWidth = 1;
    ctx.beginPath();
    ctx.arc(...at(home), 8, 0, 7);
    ctx.stroke();
  }
  drawWay(ctx, view, at);
  for (const agent of view.agents) {
    if (agent.dock !== null || agent.place === null) continue;
    drawMussel(ctx, at(agent.place), 9, agent, marked);
  }
  if (view.apad) drawApad(ctx, at(view.apad.place), data, view, marked);
  drawScaleBar(ctx, toScreen.perMetre, width, height);
}

function mapScale(data, width, height) {
  const points = [...data.polygon, ...Object.values(data.homes), ...data.trace.map(([, n, e]) => [n, e])];
  const norths = points.map((p) => p[0]), easts = points.map((p) => p[1]);
  const least = (list) => list.reduce((a, b) => Math.min(a, b)), most = (list) => list.reduce((a, b) => Math.max(a, b));
  const [south, north, west, east] = [least(norths), most(norths), least(easts), most(easts)];
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
    stroke(ctx, "#eef1f4", [[toScreen.x(e), 0], [toScreen.x(e), height]]);
    ctx.textAlign = "center";
    ctx.fillText(+e.toFixed(3), toScreen.x(e), height - 7);
  }
  for (let n = Math.ceil(north0 / step) * step; toScreen.y(n) > 0; n += step) {
    stroke(ctx, "#eef1f4", [[0, toScreen.y(n)], [width, toScreen.y(n)]]);
    ctx.textAlign = "left";
    if (toScreen.y(n) < height - 18) ctx.fillText(+n.toFixed(3), 3, toScreen.y(n) - 7);
  }
  ctx.textAlign = "right";
  ctx.fillText("east, m", width - 4, height - 21);
  ctx.textAlign = "left";
  ctx.fillText("north, m", 3, 8);
}

// The aPad's whole track so far, pale; its last five minutes, clear.
function drawTrace(ctx, trace, nowMs, at) {
  const so_far = trace.filter(([ms]) => ms <= nowMs);
  const recent = so_far.filter(([ms]) => ms >= nowMs - RECENT_MS);
  ctx.lineWidth = 1.5;
  stroke(ctx, "#1f4e7926", so_far.map(([, n, e]) => at([n, e])));
  ctx.lineWidth = 2;
  stroke(ctx, "#1f4e79b0", recent.map(([, n, e]) => at([n, e])));
}

function drawWay(ctx, view, at) {
  if (!view.apad || view.way.length === 0) return;
  ctx.setLineDash([4, 5]);
  ctx.lineWidth = 1.5;
  stroke(ctx, "#c77d0a", [view.apad.place, ...view.way].map(at));
  ctx.setLineDash([]);
}

function drawMussel(ctx, [x, y], radius, agent, marked) {
  ctx.beginPath();
  ctx.arc(x, y, radius, 0, 7);
  ctx.fillStyle = STATUS_COLOURS[agent.status];
  ctx.fill();
  ctx.lineWidth = marked === agent.id ? 3 : 1.5;
  ctx.strokeStyle = marked === agent.id ? INK : "#fff";
  ctx.stroke();
  ctx.fillStyle = "#fff";
  ctx.font = "bold 10px system-ui, 'DejaVu Sans', sans-serif";
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.fillText(agent.id, x, y + 0.5);
  ctx.font = FONT;
}

// The aPad's hull with its bow, its docks and the docked aMussels, larger than in reality.
function drawApad(ctx, [x, y], data, view, marked) {
  const heading = view.apad.heading;
  ctx.save();
  ctx.translate(x, y);
  ctx.rotate(heading);
  ctx.fillStyle = "#f2b53c";
  ctx.strokeStyle = "#7a5200";
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
  // Full docks side by side have 17 pixels each.
  const ring = Math.max(19, 17 * data.dock_bearings.length / (2 * Math.PI));
  data.dock_bearings.forEach((bearing, dock) => {
    const angle = (data.docks_turn ? heading : 0) + bearing;
    const place = [x + ring * Math.sin(angle), y - ring * Math.cos(angle)];
    const agent = view.agents.find((it) => it.dock === dock);
    if (agent) { drawMussel(ctx, place, 8, agent, marked); return; }
    ctx.beginPath();
    ctx.arc(...place, 5, 0, 7);
    ctx.fillStyle = "#fff";
    ctx.fill();
    ctx.lineWidth = 1.5;
    ctx.strokeStyle = "#7a5200";
    ctx.stroke();
  });
}

function drawScaleBar(ctx, perMetre, width, height) {
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
