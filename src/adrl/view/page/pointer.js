const CLICK_PX = 5;
const NEAR_PX = 12;
const STEP_PX = 14;
const MOVES_MS = 50;

/** What a person is doing with each lane, whatever is built anew meanwhile. */
const steering = [];

/** Metres at a point of a canvas, in its own pixels, and the length of a pixel. */
function metresAt(lane, px, py) {
  const { width, height } = lane.canvas.getBoundingClientRect();
  const { x, y, side } = lane.view();
  const scale = side / Math.min(width, height);
  return { x: x + (px - width / 2) * scale, y: y - (py - height / 2) * scale, scale };
}

function pixelOf(lane, [x, y]) {
  const { width, height } = lane.canvas.getBoundingClientRect();
  const view = lane.view();
  const scale = Math.min(width, height) / view.side;
  return [width / 2 + (x - view.x) * scale, height / 2 - (y - view.y) * scale];
}

/** The obstacle at a place, or the nearest one within reach: {kind, index}, or null. */
function obstacleAt(lane, { x, y, scale }) {
  if (!lane.now) return null;
  const { world } = stage;
  const time = lane.now.time_s;
  const found = [
    ...groups(world.circles, 3).map(([cx, cy, r], index) => ({ kind: 'circles', index, away: Math.hypot(x - cx, y - cy) - r })),
    ...groups(world.discs, 8).map((disc, index) => {
      const [cx, cy] = discPlace(disc, time);
      return { kind: 'discs', index, away: Math.hypot(x - cx, y - cy) - disc[4] };
    }),
    ...world.polygons.map((flat, index) => ({ kind: 'polygons', index, away: awayFrom(groups(flat, 2), x, y) })),
  ].filter(({ away }) => away < NEAR_PX * scale).sort((a, b) => a.away - b.away);
  return found.length ? { kind: found[0].kind, index: found[0].index } : null;
}

/** Distance to a convex polygon, 0 in it. */
function awayFrom(corners, x, y) {
  let inside = true;
  let nearest = Infinity;
  corners.forEach(([ax, ay], i) => {
    const [bx, by] = corners[(i + 1) % corners.length];
    const [ex, ey] = [bx - ax, by - ay];
    if (ex * (y - ay) - ey * (x - ax) < 0) inside = false;
    const share = Math.min(1, Math.max(0, (ex * (x - ax) + ey * (y - ay)) / (ex * ex + ey * ey)));
    nearest = Math.min(nearest, Math.hypot(x - ax - share * ex, y - ay - share * ey));
  });
  return inside ? 0 : nearest;
}

function outline({ kind, index }, lane) {
  const { world } = stage;
  if (kind === 'polygons') return (context) => groups(world.polygons[index] ?? [], 2).forEach(([x, y]) => context.lineTo(x, y));
  const [x, y, r] = kind === 'circles' ? groups(world.circles, 3)[index] : [...discPlace(groups(world.discs, 8)[index], lane.now.time_s), groups(world.discs, 8)[index][4]];
  return (context) => context.arc(x, y, r, 0, 2 * Math.PI);
}

/** Click: a goal. Drag: the obstacle there. By keyboard a crosshair does both. */
function steerable(lane, index) {
  const { canvas } = lane;
  const state = steering[index] ??= { held: null, at: null, from: null, cross: null, owed: [0, 0], sent: 0 };
  lane.steered = true;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return metresAt(lane, event.clientX - box.left, event.clientY - box.top);
  };
  const aim = () => { state.cross ??= lane.now && (lane.now.goal ?? lane.now.pose).slice(0, 2); };
  const move = (dx, dy, force = false) => {
    state.owed = [state.owed[0] + dx, state.owed[1] + dy];
    if (!force && performance.now() - state.sent < MOVES_MS) return;
    if (state.owed[0] || state.owed[1]) ask({ do: 'move', ...state.held, dx: state.owed[0], dy: state.owed[1] });
    state.owed = [0, 0];
    state.sent = performance.now();
  };
  lane.over = (context, px) => {
    context.strokeStyle = colour('accent');
    context.lineWidth = 2.5 * px;
    if (state.held) {
      context.beginPath();
      outline(state.held, lane)(context);
      context.closePath();
      context.stroke();
    }
    if (!state.cross || document.activeElement !== canvas) return;
    const [x, y] = state.cross;
    context.beginPath();
    for (const [dx, dy] of [[1, 0], [0, 1]]) {
      context.moveTo(x - 14 * px * dx, y - 14 * px * dy);
      context.lineTo(x + 14 * px * dx, y + 14 * px * dy);
    }
    context.stroke();
  };
  canvas.addEventListener('pointerdown', (event) => {
    if (event.button !== 0 || !lane.now) return;
    canvas.setPointerCapture(event.pointerId);
    const at = place(event);
    Object.assign(state, { from: [event.clientX, event.clientY], at, held: obstacleAt(lane, at), moved: false, cross: null });
    lane.redraw();
  });
  // A finger on an obstacle drags it; elsewhere it scrolls the page.
  canvas.addEventListener('touchstart', (event) => { if (obstacleAt(lane, place(event.touches[0]))) event.preventDefault(); }, { passive: false });
  canvas.addEventListener('pointermove', (event) => {
    if (!state.from || !lane.now) return;
    if (Math.hypot(event.clientX - state.from[0], event.clientY - state.from[1]) > CLICK_PX) state.moved = true;
    if (!state.moved || !state.held) return;
    const at = place(event);
    move(at.x - state.at.x, at.y - state.at.y);
    state.at = at;
  });
  const done = (event) => {
    if (!state.from) return;
    if (state.held && state.moved) move(0, 0, true);
    else if (event.type === 'pointerup' && !state.moved) ask({ do: 'goal', x: state.at.x, y: state.at.y });
    Object.assign(state, { from: null, held: null });
    lane.redraw();
  };
  canvas.addEventListener('pointerup', done);
  canvas.addEventListener('pointercancel', done);
  canvas.addEventListener('focus', () => { aim(); lane.redraw(); });
  canvas.addEventListener('blur', () => { state.held = null; lane.redraw(); });
  canvas.addEventListener('keydown', (event) => {
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    aim();
    if (!state.cross || event.ctrlKey || event.metaKey || event.altKey) return;
    const [px, py] = pixelOf(lane, state.cross);
    const { scale } = metresAt(lane, px, py);
    if (event.key in arrows) {
      const [dx, dy] = arrows[event.key].map((way) => way * STEP_PX * scale);
      state.cross = [state.cross[0] + dx, state.cross[1] + dy];
      if (state.held) move(dx, dy, true);
    } else if (event.key === 'Enter') ask({ do: 'goal', x: state.cross[0], y: state.cross[1] });
    else if (event.key === ' ') state.held = state.held ? null : obstacleAt(lane, { x: state.cross[0], y: state.cross[1], scale });
    else if (event.key === 'p') ask({ do: 'pillar', x: state.cross[0], y: state.cross[1] });
    else if (event.key === 'o') ask({ do: 'person', x: state.cross[0], y: state.cross[1] });
    else return;
    event.preventDefault();
    lane.redraw();
  });
}

link.listeners.push({
  setup({ kind }, again) {
    if (!again) steering.forEach((state) => Object.assign(state, { held: null, from: null })); // other obstacles stand there
    if (kind === 'drive') stage.lanes.forEach((lane, i) => { if (!lane.steered) steerable(lane, i); });
  },
});
