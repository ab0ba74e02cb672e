const SPEEDS = [['1', '1×'], ['2', '2×'], ['4', '4×'], ['8', '8×']];
const FOLLOW_M = 8;
const player = { select: () => {} };

const replayName = (replay) => `task ${replay.task}${replay.robot ? ` of ${replay.robot}` : ''}: ${replay.ending}, ${fixed(replay.time_s.at(-1))} s`;
const findReplay = (evaluation, task) => evaluation.replays.findIndex((replay) => replay.task === task);

/** Seconds in which the robot neither drove nor turned, as adrl.evaluation.social counts them. */
function stoodFor(replay, { twist }) {
  return replay.time_s.slice(1).reduce((sum, time, i) => {
    const still = Math.abs(twist(i + 1, 0)) < 0.02 && Math.abs(twist(i + 1, 1)) < 0.05;
    return sum + (still ? time - replay.time_s[i] : 0);
  }, 0);
}

function buildReplay() {
  const known = DATA.evaluations.map((evaluation, e) => [evaluation, e]).filter(([evaluation]) => evaluation.replays.length);
  if (!known.length) return;
  const body = reveal('replay').querySelector('.body');
  const state = { evaluation: null, replay: null, time: 0, playing: false, speed: 2, follow: false, before: 0 };

  const options = known.map(([evaluation, e]) => [evaluation.label, evaluation.replays.map((r, i) => [`${e}:${i}`, replayName(r)])]);
  const choice = chooser('Episode', options, (value) => select(...value.split(':').map(Number)));
  choice.select.id = 'episode';
  const flat = options.flatMap(([, pairs]) => pairs.map(([value]) => value));
  const step = (by) => {
    const at = flat.indexOf(choice.select.value);
    select(...flat[(at + by + flat.length) % flat.length].split(':').map(Number));
  };
  const previous = el('button', { type: 'button', class: 'button', 'aria-label': 'Previous episode', onclick: () => step(-1) }, '‹');
  const next = el('button', { type: 'button', class: 'button', 'aria-label': 'Next episode', onclick: () => step(1) }, '›');
  const follow = el('button', {
    type: 'button', class: 'button', 'aria-pressed': 'false',
    onclick: () => { state.follow = !state.follow; show(); },
  }, 'Follow the robot');

  const canvas = el('canvas', { class: 'world', role: 'img' });
  const play = el('button', { type: 'button', class: 'button primary', id: 'play', onclick: () => setPlaying(!state.playing) }, '▶ Play');
  const scrub = el('input', { type: 'range', id: 'scrub', min: 0, step: 0.05, 'aria-label': 'Time in the episode', oninput: () => { setPlaying(false); seek(Number(scrub.value)); } });
  const clock = el('output', { for: 'scrub' });
  const speed = chooser('Speed', SPEEDS, (value) => { state.speed = Number(value); });
  speed.select.value = String(state.speed);
  const marks = [['robot', 'robot', ''], ['scan', 'scan', ''], ['muted', 'A* path', 'dots'], ['goal', 'goal', 'ring'], ['waypoint', 'waypoint', ''], ['moving', 'moving', '']];
  const legend = el('ul', { class: 'legend' }, ...marks.map(([name, text, kind]) => el(
    'li', { 'data-mark': name }, el('span', { class: `swatch ${kind}`, style: `background: var(--${name}); border-color: var(--${name})` }), text,
  )));

  const held = el('p', { class: 'note small', id: 'held', hidden: true });
  const chips = el('ul', { class: 'chips' });
  const seekTo = (time) => { setPlaying(false); seek(time); };
  const strips = {
    weights: strip('Reward weights (eqs 14–16)', [], { stacked: true, onSeek: seekTo }),
    paid: strip('Shaping reward so far, by term (eq 17)', [], { onSeek: seekTo }),
    motion: strip('Motion', ['m/s', 'rad/s', 'm'], { onSeek: seekTo }),
  };
  body.append(
    el('div', { class: 'controls' }, choice.element, previous, next, follow),
    el('div', { class: 'stage' },
      el('div', { class: 'card' }, canvas, el('div', { class: 'transport' }, play, scrub, clock, speed.element), held, legend),
      el('div', { class: 'side' }, chips, ...Object.values(strips).map((s) => s.element))),
  );

  const redraw = sharp(canvas, (context, width, height) => {
    if (!state.replay) return;
    const whole = wholeView(state.replay);
    const [x, y] = poseAt(state.replay, state.time);
    const view = state.follow ? { x, y, side: Math.min(FOLLOW_M, whole.side) } : whole;
    drawScene(context, width, height, momentOf(state.evaluation, state.replay, { time: state.time }), { view, redraw: () => redraw() });
  });

  function show() {
    const end = state.replay.time_s.at(-1);
    scrub.value = state.time;
    scrub.setAttribute('aria-valuetext', `${fixed(state.time)} seconds of ${fixed(end)}`);
    clock.textContent = `${fixed(state.time)} of ${fixed(end)} s`;
    canvas.dataset.frame = frameAt(state.replay, state.time).frame;
    follow.setAttribute('aria-pressed', String(state.follow));
    const why = heldFor(state.replay, (state.replay.robot_shape ?? state.evaluation.robot_shape).reach_m, state.time);
    held.hidden = why === null;
    held.textContent = why ?? '';
    Object.values(strips).forEach((s) => s.at(state.time));
    redraw();
  }

  function seek(time) {
    state.time = Math.min(Math.max(time, 0), state.replay.time_s.at(-1));
    show();
  }

  function setPlaying(playing) {
    if (playing && state.time >= state.replay.time_s.at(-1)) state.time = 0;
    state.playing = playing;
    play.textContent = playing ? '❚❚ Pause' : '▶ Play';
    state.before = performance.now();
    if (playing) requestAnimationFrame(tick);
  }

  function tick(now) {
    if (!state.playing) return;
    seek(state.time + (state.speed * Math.max(0, now - state.before)) / 1000);
    state.before = now;
    if (state.time >= state.replay.time_s.at(-1)) setPlaying(false);
    else requestAnimationFrame(tick);
  }

  function select(e, i, { at = 0, scroll = false } = {}) {
    const evaluation = DATA.evaluations[e];
    const replay = evaluation.replays[i];
    Object.assign(state, { evaluation, replay });
    const read = opened(replay);
    choice.select.value = `${e}:${i}`;
    scrub.max = replay.time_s.at(-1);
    state.follow = wholeView(replay).side > 16;
    canvas.setAttribute('aria-label', `${evaluation.label}, ${replayName(replay)}: the robot in its world from above`);
    const curve = (array, column, name, index, decimals) => ({ name, index, decimals, value: (frame) => array(frame, column) });
    const shaping = evaluation.terms.map((name, k) => [name, k]).filter(([name]) => name !== 'success' && name !== 'failure');
    strips.weights.open(replay, shaping.map(([name, k], index) => curve(read.weights, k, name, index)));
    strips.paid.open(replay, shaping.map(([name, k], index) => curve(read.paid, k, name, index)));
    strips.motion.open(replay, [
      curve(read.twist, 0, 'speed', 0), curve(read.twist, 1, 'yaw rate', 1), curve(read.clearance, 0, 'clearance up to 1', 2),
    ]);
    showFacts(evaluation, replay, read);
    setPlaying(false);
    seek(at);
    if (scroll) document.getElementById('replay').scrollIntoView({ block: 'start' });
  }

  function showFacts(evaluation, replay, read) {
    const final = DATA.final?.[evaluation.method] ?? {};
    const facts = [[el('span', { class: `ending ${replay.ending}` }, replay.ending)], [`guidance ${evaluation.guidance}`]];
    if (known.length > 1) facts.unshift([evaluation.label]);
    if (evaluation.maturity !== null && evaluation.method !== 'astar-dwa') facts.push([`S ${fixed(evaluation.maturity, 2)} in the weights`]);
    evaluation.terms.forEach((name, k) => {
      const paid = read.paid(read.paid.rows - 1, k);
      if ((name === 'success' || name === 'failure') && paid !== 0) facts.push([`${name} pays ${fixed(paid, 2)} at the end`]);
    });
    if (replay.people) facts.push([`stood ${fixed(stoodFor(replay, read))} s`]);
    for (const [key, symbol] of [['alpha', 'α'], ['lambda_bc', 'λ']]) {
      if (key in final) facts.push([`${symbol} ${fixed(final[key], 3)} at the end of training`]);
    }
    chips.replaceChildren(...facts.map((content) => el('li', {}, ...content)));
    const moving = DATA.worlds[replay.world].discs.length > 0 || replay.people !== null;
    let guided = false;
    for (let f = 0; f < read.waypoint.rows && !guided; f += 1) {
      guided = Math.hypot(read.waypoint(f, 0) - replay.goal[0], read.waypoint(f, 1) - replay.goal[1]) > 0.05;
    }
    legend.querySelector('[data-mark=moving]').hidden = !moving;
    legend.querySelector('[data-mark=waypoint]').hidden = !guided;
  }

  player.select = select;
  select(known[0][1], 0);
}
