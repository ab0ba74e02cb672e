/**
 * A moment, from above: what the report's replays and adrl view draw. Lengths in metres, angles in radians.
 *   world: as encode.world_content makes it; time: in seconds, for the discs that move in it; people: [[x, y, radius], ...]
 *   legs: [[x, y, radius], ...], what the LiDAR sees of people where it does not see their bodies
 *   shape: the robot's, as document.robot_shape makes it; pose: [x, y, yaw]; trail: [[x, y], ...] driven so far
 *   goal: [x, y] or null; tolerance; path: [[x, y], ...] of a known map
 *   waypoint: [x, y] or null; plan: [[x, y], ...] from the robot on, a straight line to the waypoint without one
 *   scan: {pose, ranges: k -> metres} or null; map: the robot's own, a picture as that of a world's grid, or null
 *   ending: how the drive ended, or null
 */

const pictures = new WeakMap();

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

/** A body with a head, unlike a disc that moves; above legs only its outline. */
function drawPerson(context, [x, y, radius], px, onLegs) {
  context.fillStyle = colour('moving');
  context.strokeStyle = colour('moving');
  context.lineWidth = 1.5 * px;
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  if (onLegs) context.stroke();
  else context.fill();
  context.fillStyle = colour('ink');
  context.beginPath();
  context.arc(x, y, 0.4 * radius, 0, 2 * Math.PI);
  context.fill();
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

function drawScan(context, { pose: [x, y, yaw], ranges }, shape, px) {
  const [mx, my, mount] = shape.mount;
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  const sensor = [x + c * mx - s * my, y + s * mx + c * my];
  const ends = shape.angles.map((angle, k) => {
    const range = ranges(k);
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

/** A moment in a window of view.side metres about (view.x, view.y). over: draws on top, in metres. */
function drawScene(context, width, height, moment, { view, redraw = () => {}, over = () => {} }) {
  const { shape, pose: here, ending } = moment;
  context.save();
  const px = toMetres(context, width, height, view);
  context.lineJoin = 'round';
  if (moment.map) {
    context.globalAlpha = 0.55;
    drawGrid(context, moment.map, redraw);
    context.globalAlpha = 1;
  }
  drawWorld(context, moment.world, px, moment.time, redraw);
  moment.people.forEach((person) => drawPerson(context, person, px, moment.legs.length > 0));
  context.fillStyle = colour('moving');
  moment.legs.forEach(([x, y, radius]) => {
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fill();
  });
  context.strokeStyle = colour('muted');
  context.lineWidth = 1.4 * px;
  context.setLineDash([1.5 * px, 4 * px]);
  context.lineCap = 'round';
  line(context, moment.path);
  context.setLineDash([]);
  if (moment.scan) drawScan(context, moment.scan, shape, px);
  const failed = ending !== null && ending !== 'success';
  const ink = failed ? colour('bad') : colour('robot');
  for (const [stroke, thick] of [[colour('free'), 4.5], [ink, 2.4]]) {
    context.strokeStyle = stroke;
    context.lineWidth = thick * px;
    line(context, [...moment.trail, here]);
  }
  if (moment.goal) drawGoal(context, moment, px);
  drawWaypoint(context, moment, px);
  drawRobot(context, shape, here, px, ink);
  if (failed) drawCross(context, here, ending, px, shape);
  over(context, px);
  context.restore();
}

function line(context, points) {
  context.beginPath();
  points.forEach(([x, y]) => context.lineTo(x, y));
  context.stroke();
}

function drawWaypoint(context, { pose, waypoint, plan, goal }, px) {
  if (!waypoint || (goal && Math.hypot(waypoint[0] - goal[0], waypoint[1] - goal[1]) <= 0.05)) return;
  context.fillStyle = colour('waypoint');
  context.strokeStyle = colour('waypoint');
  context.lineWidth = px;
  context.globalAlpha = 0.6;
  line(context, plan ?? [pose, waypoint]);
  context.globalAlpha = 1;
  context.beginPath();
  context.arc(...waypoint, 5 * px, 0, 2 * Math.PI);
  context.fill();
}

function drawGoal(context, { goal, tolerance }, px) {
  context.strokeStyle = colour('goal');
  context.lineWidth = 2 * px;
  context.beginPath();
  context.arc(...goal, Math.max(tolerance, 5 * px), 0, 2 * Math.PI);
  context.stroke();
  context.fillStyle = colour('goal');
  context.beginPath();
  context.arc(...goal, 2.5 * px, 0, 2 * Math.PI);
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
