// A run at one mission time: what every part of the page shows of it.

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
      heard: agent.heard ? agent.heard[i] : null,
      suspicion: data.suspects.find(([since, id, , until]) => id === agent.id && since <= ms && (until === null || ms < until)) || null,
      capacity: agent.capacity && agent.capacity[i],
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
  const places = plan.steps.slice(plan.done).map(([id], n) => {
    const agent = agents.find((it) => it.id === id);
    return plan.what === "collect" ? agent && agent.dock === null && agent.place : plan.places[plan.done + n];
  });
  return places.filter(Boolean);
}
