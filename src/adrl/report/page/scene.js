const pictures = new Map();

/** A replay's arrays, unpacked once. */
function opened(replay) {
  if (!replay.read) {
    replay.read = Object.fromEntries(
      ['pose', 'waypoint', 'twist', 'clearance', 'weights', 'paid', 'ranges'].map((name) => [name, unpack(replay[name])]),
    );
  }
  return replay.read;
}

/** The last frame at or before a time, and how far it is to the next one. */
function frameAt(replay, time) {
  const times = replay.time_s;
  let low = 0;
  let high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= time + 1e-9) low = middle;
    else high = middle - 1;
  }
  const next = Math.min(low + 1, times.length - 1);
  const part = next > low ? Math.min(1, Math.max(0, (time - times[low]) / (times[next] - times[low]))) : 0;
  return { frame: low, next, part };
}

function poseAt(replay, time) {
  const { frame, next, part } = frameAt(replay, time);
  const { pose } = opened(replay);
  return [0, 1, 2].map((k) => pose(frame, k) + part * (pose(next, k) - pose(frame, k)));
}

/** A square window in metres on all of a replay's way. */
function wholeView(replay) {
  const points = groups(replay.path, 2).concat([replay.goal]);
  const { pose } = opened(replay);
  for (let i = 0; i < pose.rows; i += 1) points.push([pose(i, 0), pose(i, 1)]);
  const low = [0, 1].map((k) => Math.min(...points.map((p) => p[k])) - 1);
  const high = [0, 1].map((k) => Math.max(...points.map((p) => p[k])) + 1);
  const side = Math.max(high[0] - low[0], high[1] - low[1]);
  const [x0, y0, x1, y1] = DATA.worlds[replay.world].bounds;
  const whole = Math.max(x1 - x0, y1 - y0) * 1.03;
  if (2 * side > whole) return { x: (x0 + x1) / 2, y: (y0 + y1) / 2, side: whole };
  return { x: (low[0] + high[0]) / 2, y: (low[1] + high[1]) / 2, side };
}

/** Where a moving disc is: see adrl.types.World.discs. */
function discPlace([x1, y1, x2, y2, , speed, phase, stop], time) {
  const length = Math.hypot(x2 - x1, y2 - y1);
  const driven = speed * (stop === null ? time : Math.min(time, stop));
  const turn = length > 0 ? (phase + driven / (2 * length)) % 1 : 0;
  const share = 1 - Math.abs(1 - 2 * turn);
  return [x1 + share * (x2 - x1), y1 + share * (y2 - y1)];
}

/** Sets the context to metres, y up, and returns the length of a pixel in metres. */
function toMetres(context, width, height, view) {
  const scale = Math.min(width, height) / view.side;
  context.translate(width / 2, height / 2);
  context.scale(scale, -scale);
  context.translate(-view.x, -view.y);
  return 1 / scale;
}

function drawWorld(context, world, px, time, redraw) {
  context.fillStyle = colour('solid');
  context.strokeStyle = colour('edge');
  context.lineWidth = 1.2 * px;
  if (world.grid) drawGrid(context, world.grid, redraw);
  const shape = (trace) => { context.beginPath(); trace(); context.fill(); context.stroke(); };
  groups(world.circles, 3).forEach(([x, y, r]) => shape(() => context.arc(x, y, r, 0, 2 * Math.PI)));
  world.polygons.forEach((flat) => shape(() => {
    groups(flat, 2).forEach(([x, y]) => context.lineTo(x, y));
    context.closePath();
  }));
  context.lineWidth = 2 * px;
  context.beginPath();
  groups(world.segments, 4).forEach(([x1, y1, x2, y2]) => { context.moveTo(x1, y1); context.lineTo(x2, y2); });
  context.stroke();
  const discs = groups(world.discs, 8);
  context.strokeStyle = colour('moving');
  context.lineWidth = px;
  context.setLineDash([4 * px, 4 * px]);
  context.beginPath();
  discs.forEach(([x1, y1, x2, y2]) => { context.moveTo(x1, y1); context.lineTo(x2, y2); });
  context.stroke();
  context.setLineDash([]);
  context.fillStyle = colour('moving');
  context.strokeStyle = colour('edge');
  discs.forEach((disc) => shape(() => context.arc(...discPlace(disc, time), disc[4], 0, 2 * Math.PI)));
}

function drawGrid(context, grid, redraw) {
  let picture = pictures.get(grid);
  if (!picture) {
    picture = new Image();
    picture.onload = redraw;
    picture.src = grid.picture;
    pictures.set(grid, picture);
  }
  if (!picture.complete) return;
  const [x, y, yaw] = grid.origin;
  const [width, height] = grid.size.map((cells) => cells * grid.resolution_m);
  context.save();
  context.translate(x, y);
  context.rotate(yaw);
  context.scale(1, -1); // rows of a picture run downwards
  context.imageSmoothingEnabled = false;
  context.drawImage(picture, 0, -height, width, height);
  context.restore();
}

function drawScan(context, replay, shape, frame, px) {
  const { pose, ranges } = opened(replay);
  const [x, y, yaw] = [0, 1, 2].map((k) => pose(frame, k));
  const [mx, my, mount] = shape.mount;
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  const sensor = [x + c * mx - s * my, y + s * mx + c * my];
  const ends = shape.angles.map((angle, k) => {
    const range = ranges(frame, k);
    const at = yaw + mount + angle;
    return [sensor[0] + range * Math.cos(at), sensor[1] + range * Math.sin(at), range < 0.995 * shape.max_range_m];
  });
  context.fillStyle = colour('scan');
  context.strokeStyle = colour('scan');
  context.globalAlpha = 0.1;
  context.beginPath();
  const full = shape.angles.length * (shape.angles[1] - shape.angles[0]) > 2 * Math.PI - 0.2;
  if (!full) context.moveTo(...sensor);
  ends.forEach(([ex, ey]) => context.lineTo(ex, ey));
  context.closePath();
  context.fill();
  context.globalAlpha = 0.22;
  context.lineWidth = 0.7 * px;
  context.beginPath();
  ends.forEach(([ex, ey]) => { context.moveTo(...sensor); context.lineTo(ex, ey); });
  context.stroke();
  context.globalAlpha = 1;
  ends.filter((end) => end[2]).forEach(([ex, ey]) => context.fillRect(ex - 1.4 * px, ey - 1.4 * px, 2.8 * px, 2.8 * px));
}

function drawRobot(context, shape, [x, y, yaw], px, ink) {
  context.save();
  context.translate(x, y);
  context.rotate(yaw);
  context.beginPath();
  if (shape.radius_m !== null) context.arc(0, 0, shape.radius_m, 0, 2 * Math.PI);
  else groups(shape.polygon, 2).forEach(([px_, py]) => context.lineTo(px_, py));
  context.closePath();
  context.fillStyle = ink;
  context.fill();
  context.strokeStyle = colour('surface');
  context.lineWidth = 1.5 * px;
  context.stroke();
  const nose = Math.max(shape.reach_m, 7 * px);
  context.beginPath();
  context.moveTo(0.85 * nose, 0);
  context.lineTo(-0.35 * nose, 0.5 * nose);
  context.lineTo(-0.1 * nose, 0);
  context.lineTo(-0.35 * nose, -0.5 * nose);
  context.closePath();
  context.fillStyle = colour('surface');
  context.fill();
  context.restore();
}

/** Everything at one time. from: the driven way is drawn from this time on. */
function drawScene(context, width, height, evaluation, replay, { time, view, from = 0, redraw = () => {} }) {
  const shape = evaluation.robot_shape;
  const { pose, waypoint } = opened(replay);
  const { frame } = frameAt(replay, time);
  const last = frame === replay.time_s.length - 1;
  context.save();
  const px = toMetres(context, width, height, view);
  context.lineJoin = 'round';
  drawWorld(context, DATA.worlds[replay.world], px, time, redraw);
  context.strokeStyle = colour('muted');
  context.lineWidth = 1.4 * px;
  context.setLineDash([1.5 * px, 4 * px]);
  context.lineCap = 'round';
  context.beginPath();
  groups(replay.path, 2).forEach(([x, y]) => context.lineTo(x, y));
  context.stroke();
  context.setLineDash([]);
  drawScan(context, replay, shape, frame, px);
  const here = poseAt(replay, time);
  const failed = last && replay.ending !== 'success';
  const ink = failed ? colour('bad') : colour('robot');
  for (const [stroke, thick] of [[colour('free'), 4.5], [ink, 2.4]]) {
    context.strokeStyle = stroke;
    context.lineWidth = thick * px;
    context.beginPath();
    for (let i = frameAt(replay, from).frame; i <= frame; i += 1) context.lineTo(pose(i, 0), pose(i, 1));
    context.lineTo(here[0], here[1]);
    context.stroke();
  }
  drawGoal(context, replay, px);
  const target = [waypoint(frame, 0), waypoint(frame, 1)];
  if (Math.hypot(target[0] - replay.goal[0], target[1] - replay.goal[1]) > 0.05) {
    context.fillStyle = colour('waypoint');
    context.strokeStyle = colour('waypoint');
    context.lineWidth = px;
    context.globalAlpha = 0.6;
    context.beginPath();
    context.moveTo(here[0], here[1]);
    context.lineTo(...target);
    context.stroke();
    context.globalAlpha = 1;
    context.beginPath();
    context.arc(...target, 5 * px, 0, 2 * Math.PI);
    context.fill();
  }
  drawRobot(context, shape, here, px, ink);
  if (failed) drawCross(context, here, replay.ending, px, shape);
  context.restore();
}

function drawGoal(context, replay, px) {
  context.strokeStyle = colour('goal');
  context.lineWidth = 2 * px;
  context.beginPath();
  context.arc(...replay.goal, Math.max(replay.goal_tolerance_m, 5 * px), 0, 2 * Math.PI);
  context.stroke();
  context.fillStyle = colour('goal');
  context.beginPath();
  context.arc(...replay.goal, 2.5 * px, 0, 2 * Math.PI);
  context.fill();
}

/** A ring round the place of a collision, a square round that of a timeout. */
function drawCross(context, [x, y], ending, px, shape) {
  const r = Math.max(1.6 * shape.reach_m, 12 * px);
  context.strokeStyle = colour('bad');
  context.lineWidth = 2 * px;
  context.beginPath();
  if (ending === 'collision') context.arc(x, y, r, 0, 2 * Math.PI);
  else context.rect(x - r, y - r, 2 * r, 2 * r);
  context.stroke();
}
