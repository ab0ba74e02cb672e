const STATUS = { idle: 'no goal', driving: 'driving', reached: 'at the goal', stopped: 'held', failed: 'no way to the goal', collision: 'collision' };
const [TIME, X, Y, YAW, SPEED, TURN, CLEARANCE, WEIGHTS] = [0, 1, 2, 3, 4, 5, 6, 7];
const SHOWN_ROWS = 600;
const FOLLOW_SIDE_M = 9;
const BIG_M = 24;

const stage = { lanes: [], world: null, follow: null, setup: null };

function buildLane(about, index, setup) {
  const canvas = el('canvas', { class: 'world', tabindex: 0, role: 'img', 'data-lane': index });
  const status = el('p', { class: 'status', role: 'status' }, el('strong', {}), ' ', el('span', { class: 'why' }));
  const time = el('span', { class: 'clock' });
  const facts = [about.guidance && `guidance ${about.guidance}`, about.maturity !== null && `S ${fixed(about.maturity, 2)}`].filter(Boolean).join(' · ');
  const marks = [['robot', 'robot', ''], ['scan', 'scan', ''], ['goal', 'goal', 'ring'], ['waypoint', about.guidance === 'goal' ? 'plan' : 'waypoint and plan', ''], ['moving', 'moving', '']];
  if (about.guidance === 'map') marks.splice(2, 0, ['muted', 'A* path', 'dots']);
  const legend = el('ul', { class: 'legend' }, ...marks.map(([name, text, kind]) => el(
    'li', {}, el('span', { class: `swatch ${kind}`, style: `background: var(--${name}); border-color: var(--${name})` }), text,
  )));
  const onSeek = setup.kind === 'recording' ? (time_s) => ask({ do: 'seek', time_s }) : () => {};
  const strips = [];
  const rows = [];
  const history = { time_s: [] };
  const curve = (name, column, i) => ({ name, index: i, value: (row) => rows[row][column] });
  if (about.terms.length) {
    const weights = strip('Reward weights (eqs 14–16)', [], { stacked: true, onSeek });
    weights.open(history, about.terms.map((name, k) => curve(name, WEIGHTS + k, k)));
    strips.push(weights);
  }
  const motion = strip('Motion', ['m/s', 'rad/s', 'm'], { onSeek });
  const clear = setup.kind === 'drive' || setup.kind === 'training';
  motion.open(history, [curve('speed', SPEED, 0), curve('yaw rate', TURN, 1), ...(clear ? [curve('clearance up to 1', CLEARANCE, 2)] : [])]);
  strips.push(motion);
  const element = el('div', { class: 'lane' },
    el('div', { class: 'card' },
      el('div', { class: 'head' }, el('h3', {}, about.label), el('span', {}, facts), time),
      canvas, status, legend, about.note ? el('details', { class: 'note small' }, el('summary', {}, 'trained for another robot'), about.note) : null),
    el('div', { class: 'side' }, ...strips.map((s) => s.element)));
  const lane = { key: laneKey(about, setup), canvas, element };

  lane.begin = (past) => {
    rows.splice(0, rows.length, ...past.slice(-SHOWN_ROWS));
    history.time_s = rows.map((row) => row[TIME]);
    Object.assign(lane, { now: null, from: null, since: 0, map: null, trail: past.map((row) => [row[X], row[Y]]) });
  };
  lane.view = () => viewOf(lane);
  lane.over = () => {};
  lane.redraw = sharp(canvas, (context, width, height) => {
    if (lane.now) drawScene(context, width, height, lane.moment(), { view: lane.view(), redraw: () => lane.redraw(), over: lane.over });
  });
  lane.moment = () => {
    const { now } = lane;
    return {
      world: stage.world, time: now.time_s, people: groups(now.people, 3), legs: groups(now.legs, 3), shape: about.shape, pose: lane.pose(), trail: lane.trail.slice(0, -1),
      goal: now.goal, tolerance: now.tolerance, path: groups(now.path, 2), waypoint: now.waypoint,
      plan: now.plan.length ? [lane.pose(), ...groups(now.plan, 2).slice(1)] : null,
      scan: now.ranges.length ? { pose: now.pose, ranges: (k) => now.ranges[k] ?? about.shape.max_range_m } : null, map: lane.map, ending: now.status === 'collision' ? 'collision' : null,
    };
  };
  /** Between two frames the robot is drawn on its way from the one to the other. */
  lane.pose = () => {
    const { from, now } = lane;
    if (!from) return now.pose;
    const part = Math.min(1, (performance.now() - lane.since) / lane.lasts);
    return now.pose.map((value, k) => (k === YAW - 1 ? from[k] + part * Math.atan2(Math.sin(value - from[k]), Math.cos(value - from[k])) : from[k] + part * (value - from[k])));
  };
  lane.take = (news, playing) => {
    const { now } = lane;
    const added = news.rows.filter((row) => !rows.length || row[TIME] > rows.at(-1)[TIME]);
    rows.push(...added);
    rows.splice(0, Math.max(0, rows.length - SHOWN_ROWS));
    history.time_s = rows.map((row) => row[TIME]);
    lane.trail.push(...added.map((row) => [row[X], row[Y]]));
    const moved = now && (now.pose[0] !== news.pose[0] || now.pose[1] !== news.pose[1] || now.pose[2] !== news.pose[2]);
    if (moved || !now) {
      const instant = performance.now();
      lane.from = moved && playing ? lane.pose() : null;
      lane.lasts = Math.min(250, Math.max(30, instant - lane.since));
      lane.since = instant;
    }
    lane.now = news;
    if ('map' in news) takeMap(lane, news.map);
    lane.show();
  };
  lane.show = () => {
    const { now } = lane;
    const name = now.status === 'idle' && now.arrived ? 'reached' : now.status;
    status.dataset.status = name;
    status.querySelector('strong').textContent = STATUS[name] ?? name;
    const why = [now.message, inWords(now.reasons)].filter(Boolean).join(' · ');
    if (status.querySelector('.why').textContent !== why) status.querySelector('.why').textContent = why;
    time.textContent = `${fixed(now.time_s)} s`;
    canvas.setAttribute('aria-label', `${about.label}, ${STATUS[name] ?? name}, at ${fixed(now.pose[0])}, ${fixed(now.pose[1])} m${now.goal ? `, goal ${fixed(now.goal[0])}, ${fixed(now.goal[1])} m` : ''}. Arrow keys move the crosshair.`);
    canvas.dataset.time = now.time_s;
    canvas.dataset.status = name;
    if (rows.length) strips.forEach((s) => s.at(rows.at(-1)[TIME]));
    lane.redraw();
  };
  return lane;
}

/** What a lane is built for; its rows come and go. */
const laneKey = ({ rows, ...about }, { kind }) => JSON.stringify([kind, about]);

/** A picture is shown once it is loaded, and the one before until then. */
function takeMap(lane, map) {
  if (!map) { lane.map = null; return; }
  const picture = new Image();
  picture.onload = () => { pictures.set(map, picture); lane.map = map; lane.redraw(); };
  picture.src = map.picture;
}

/** The window of a lane: all of the world, or what is about the robot. */
function viewOf(lane) {
  const { bounds } = stage.world;
  const [x0, y0, x1, y1] = bounds;
  const side = 1.03 * Math.max(x1 - x0, y1 - y0);
  if (!stage.follow || !lane.now) return { x: (x0 + x1) / 2, y: (y0 + y1) / 2, side };
  const [x, y] = lane.pose();
  return { x, y, side: Math.min(side, FOLLOW_SIDE_M) };
}

function animate() {
  stage.lanes.forEach((lane) => { if (lane.from && performance.now() - lane.since < lane.lasts + 50) lane.redraw(); });
  requestAnimationFrame(animate);
}

/** A lane that shows the same as before stays, with the focus and the pointer that are on it. */
function showLanes(setup) {
  const before = stage.lanes;
  const focused = before.findIndex(({ canvas }) => canvas === document.activeElement);
  stage.lanes = setup.lanes.map((about, i) => (before[i]?.key === laneKey(about, setup) ? before[i] : buildLane(about, i, setup)));
  stage.lanes.forEach((lane, i) => lane.begin(setup.lanes[i].rows));
  if (stage.setup && before.length === stage.lanes.length && stage.lanes.every((lane, i) => lane === before[i])) return;
  const empty = el('p', { class: 'note' }, 'No policy drives yet: the run has no checkpoint. A shorter --checkpoint-interval-steps brings the first one earlier.');
  document.getElementById('stage').replaceChildren(setup.lanes.length ? el('div', { class: setup.lanes.length > 1 ? 'lanes two' : 'lanes' }, ...stage.lanes.map((lane) => lane.element)) : empty);
  stage.lanes[focused]?.canvas.focus({ preventScroll: true });
}

link.listeners.push({
  setup(setup) {
    const before = stage.setup && JSON.stringify(stage.setup.world?.bounds);
    stage.world = setup.world;
    if (setup.world && before !== JSON.stringify(setup.world.bounds)) {
      const [x0, y0, x1, y1] = setup.world.bounds;
      stage.follow = remembered.get('follow', Math.max(x1 - x0, y1 - y0) > BIG_M);
    }
    showLanes(setup);
    stage.setup = setup;
    document.documentElement.dataset.kind = setup.kind;
    document.querySelectorAll('[data-for]').forEach((node) => { node.hidden = !node.dataset.for.split(' ').includes(setup.kind); });
  },
  frame(frame) {
    if (frame.obstacles) stage.world = Object.assign(stage.world, frame.obstacles);
    frame.lanes.forEach((news, i) => stage.lanes[i]?.take(news, frame.playing));
  },
});
