/** A replay's arrays, unpacked once. */
function opened(replay) {
  if (!replay.read) {
    replay.read = Object.fromEntries(
      ['pose', 'waypoint', 'twist', 'clearance', 'weights', 'paid', 'ranges'].map((name) => [name, unpack(replay[name])]),
    );
    if (replay.people) replay.read.people = unpack(replay.people.places);
  }
  return replay.read;
}

function poseAt(replay, time) {
  const { frame, next, part } = frameAt(replay, time);
  const { pose } = opened(replay);
  return [0, 1, 2].map((k) => pose(frame, k) + part * (pose(next, k) - pose(frame, k)));
}

/** [x, y, radius] of the people at a time. */
function peopleAt(replay, time) {
  if (!replay.people) return [];
  const { people } = opened(replay);
  const { frame, next, part } = frameAt(replay, time);
  const at = (k) => people(frame, k) + part * (people(next, k) - people(frame, k));
  return replay.people.radius_m.map((radius, k) => [at(2 * k), at(2 * k + 1), radius]);
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
    people: peopleAt(replay, time),
    shape: replay.robot_shape ?? evaluation.robot_shape,
    pose: poseAt(replay, time),
    trail: Array.from({ length: frame + 1 - first }, (_, i) => at(first + i)),
    goal: replay.goal,
    tolerance: replay.goal_tolerance_m,
    path: groups(replay.path, 2),
    waypoint: [waypoint(frame, 0), waypoint(frame, 1)],
    scan: { pose: at(frame), ranges: (k) => ranges(frame, k) },
    map: null,
    ending: frame === replay.time_s.length - 1 ? replay.ending : null,
  };
}
