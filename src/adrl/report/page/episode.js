/** A replay's arrays, unpacked once. */
function opened(replay) {
  if (!replay.read) {
    replay.read = Object.fromEntries(
      ['pose', 'waypoint', 'twist', 'clearance', 'weights', 'paid', 'ranges'].map((name) => [name, unpack(replay[name])]),
    );
    for (const name of ['people', 'legs']) if (replay[name]) replay.read[name] = unpack(replay[name].places);
  }
  return replay.read;
}

function poseAt(replay, time) {
  const { frame, next, part } = frameAt(replay, time);
  const { pose } = opened(replay);
  return [0, 1, 2].map((k) => pose(frame, k) + part * (pose(next, k) - pose(frame, k)));
}

/** [x, y, radius] of the people, or of their legs, at a time. */
function bodiesAt(replay, name, time) {
  if (!replay[name]) return [];
  const places = opened(replay)[name];
  const { frame, next, part } = frameAt(replay, time);
  const at = (k) => places(frame, k) + part * (places(next, k) - places(frame, k));
  return replay[name].radius_m.map((radius, k) => [at(2 * k), at(2 * k + 1), radius]);
}

/** What the supervisor changed the command for at a time, in words; null without a supervisor. reach: from the robot's centre to its edge. */
function heldFor(replay, reach, time) {
  if (!replay.held) return null;
  const reasons = replay.held.findLast(([from]) => from <= time + 1e-6)?.[1] ?? [];
  if (!reasons.length) return 'The supervisor lets the policy drive.';
  const nearest = reasons.includes('obstacle') ? ` · nearest: ${nearestAt(replay, reach, time)}` : '';
  return `Supervisor: ${inWords(reasons)}${nearest}`;
}

/** What is nearest to the robot. */
function nearestAt(replay, reach, time) {
  const { clearance } = opened(replay);
  const [x, y] = poseAt(replay, time);
  const away = Math.min(...bodiesAt(replay, 'people', time).map(([px, py, radius]) => Math.hypot(px - x, py - y) - radius - reach), Infinity);
  const clear = clearance(frameAt(replay, time).frame, 0);
  if (away <= clear + 0.1) return `a person at ${fixed(Math.max(away, 0), 2)} m`;
  return clear < 1 ? `what stands at ${fixed(clear, 2)} m` : 'nothing within 1 m';
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

/** The moment of a replay at a time; see scene.js. from: the driven way is drawn from this time on. */
function momentOf(evaluation, replay, { time, from = 0 }) {
  const { pose, waypoint, ranges } = opened(replay);
  const { frame } = frameAt(replay, time);
  const at = (i) => [0, 1, 2].map((k) => pose(i, k));
  const first = frameAt(replay, from).frame;
  return {
    world: DATA.worlds[replay.world],
    time,
    people: bodiesAt(replay, 'people', time),
    legs: bodiesAt(replay, 'legs', time),
    shape: replay.robot_shape ?? evaluation.robot_shape,
    pose: poseAt(replay, time),
    trail: Array.from({ length: frame + 1 - first }, (_, i) => at(first + i)),
    goal: replay.goal,
    tolerance: replay.goal_tolerance_m,
    path: groups(replay.later_paths.findLast(([since]) => since <= time + 1e-6)?.[1] ?? replay.path, 2),
    waypoint: [waypoint(frame, 0), waypoint(frame, 1)],
    scan: { pose: at(frame), ranges: (k) => ranges(frame, k) },
    map: null,
    ending: frame === replay.time_s.length - 1 ? replay.ending : null,
  };
}
