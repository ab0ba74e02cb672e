const KINDS = { run: 'Training run', comparison: 'Comparison of methods', evaluation: 'Evaluation' };

function buildHeader() {
  document.getElementById('kind').textContent = `ADRL · ${KINDS[DATA.kind]}`;
  document.getElementById('name').textContent = DATA.name;
  document.getElementById('facts').append(...DATA.facts.map(([name, value]) => el('div', {}, el('dt', {}, name), el('dd', {}, value))));
  buildTheme();
}

const TILES = [
  ['success', 'Success', 1, 100, ' %'], ['collision', 'Collision', 1, 100, ' %'], ['at_fault', 'At fault', 1, 100, ' %'], ['timeout', 'Timeout', 1, 100, ' %'],
  ['spl', 'SPL', 2, 1, ''], ['optimality', 'Path / shortest', 2, 1, ''], ['time_s', 'Time to goal', 1, 1, ' s'], ['seconds_to_90', 'Training to 90 %', 1, 1, ' s'],
];

function buildResults() {
  if (!DATA.rows.length) return;
  const section = reveal('results');
  const [first] = DATA.rows;
  const tiles = section.querySelector('.tiles');
  tiles.before(el('p', { class: 'note' }, el('strong', {}, first.label), ` · ${first.note} · with 95 % intervals`));
  TILES.filter(([key]) => typeof first[key] === 'number').forEach(([key, title, decimals, scale, unit]) => {
    const [low, high] = [first[`${key}_low`], first[`${key}_high`]];
    const known = typeof low === 'number' && typeof high === 'number';
    tiles.append(el('div', { class: 'tile' },
      el('div', { class: 'what' }, title),
      el('div', { class: 'value' }, fixed(first[key], decimals, scale) + unit),
      el('div', { class: 'range' }, known ? `${fixed(low, decimals, scale)} – ${fixed(high, decimals, scale)}` : '')));
  });
  const columns = [
    {
      key: 'label', title: DATA.kind === 'comparison' ? 'Method' : 'Evaluation', text: true, value: (row) => row.label,
      cell: (row) => [row.label, el('span', { class: 'range' }, row.note)],
    },
    metric('success', 'Success, %', 1, 100), metric('collision', 'Collision, %', 1, 100), metric('timeout', 'Timeout, %', 1, 100),
    metric('distance_m', 'Distance, m', 1, 1, 'over successes'), metric('time_s', 'Time, s', 1, 1, 'over successes'),
    metric('optimality', 'Path / shortest', 2, 1, 'over successes'), metric('spl', 'SPL', 2),
  ];
  if (DATA.kind === 'comparison') {
    columns.splice(2, 0, metric('success_iqm', 'IQM, %', 1, 100), metric('success_worst', 'Worst seed, %', 1, 100));
    columns.push(metric('seconds_to_90', 'To 90 %, s', 1, 1, 'wall clock of training, median over seeds'), metric('improvement', 'adrl better, %', 0, 100, 'chance that a seed of adrl beats one of the method'));
  } else {
    columns.push(metric('least_clearance_m', 'Clearance, m', 2), metric('smoothness', 'Yaw accel., rad/s²', 2));
  }
  if (DATA.rows.some((row) => 'at_fault' in row)) {
    columns.splice(columns.findIndex(({ key }) => key === 'collision') + 1, 0, metric('at_fault', 'At fault, %', 1, 100, 'collisions in which the robot moved into something'));
    columns.push(
      metric('person_distance_m', 'Nearest person, m', 2), metric('near_person_s', 'Within 0.5 m, s', 1),
      metric('frozen_s', 'Frozen, s', 1), metric('lost_s', 'Lost, s', 1, 1, 'to the clear path at full speed, over successes'),
    );
  }
  const table = sortable('Results', columns);
  table.element.id = 'results-table';
  table.show(DATA.rows);
  const body = section.querySelector('.body');
  body.append(table.element, el('p', { class: 'note small', style: 'margin-top: .6rem' }, DATA.kind === 'comparison'
    ? 'Means over training seeds with 95 % bootstrap intervals; a planner has no seeds, its intervals are over episodes. Distance, time and path ratio over successes.'
    : 'Below each estimate its 95 % interval over episodes. Distance, time and path ratio over successes.'));
  if (DATA.missing.length) body.append(el('p', { class: 'note' }, `Not in it: ${DATA.missing.join(', ')}.`));
}

const GALLERY_M = 5;
const GALLERY_S = 5;

function buildGallery() {
  const failures = DATA.evaluations.flatMap((evaluation, e) => evaluation.replays
    .map((replay, i) => ({ evaluation, replay, e, i })).filter(({ replay }) => replay.ending !== 'success'));
  if (!failures.length) return;
  failures.sort((a, b) => (a.replay.ending === b.replay.ending ? 0 : a.replay.ending < b.replay.ending ? -1 : 1));
  const section = reveal('failures');
  const total = DATA.evaluations.reduce((sum, { tasks }) => sum + tasks.ending.filter((ending) => ending !== 'success').length, 0);
  section.querySelector('.note').textContent = `${failures.length} of ${total} failed episodes, their last ${GALLERY_S} seconds. A picture opens its replay.`;
  const gallery = section.querySelector('.gallery');
  const several = new Set(failures.map(({ e }) => e)).size > 1;
  failures.forEach(({ evaluation, replay, e, i }) => {
    const canvas = el('canvas', {});
    const end = replay.time_s.at(-1);
    const [x, y] = poseAt(replay, end);
    const left = Math.hypot(x - replay.goal[0], y - replay.goal[1]);
    gallery.append(el('button', { type: 'button', class: 'shot', onclick: () => player.select(e, i, { at: Math.max(0, end - GALLERY_S), scroll: true }) },
      canvas,
      el('span', {}, el('strong', {}, `Task ${replay.task}`), el('span', { class: `ending ${replay.ending}` }, replay.ending),
        `after ${fixed(end)} s, ${fixed(left)} m short of the goal`, several ? el('span', {}, evaluation.label) : null)));
    const moment = () => momentOf(evaluation, replay, { time: end, from: Math.max(0, end - GALLERY_S) });
    const redraw = sharp(canvas, (context, width, height) => drawScene(context, width, height, moment(), {
      view: { x, y, side: GALLERY_M }, redraw: () => redraw(),
    }));
  });
}

function buildTasks() {
  if (DATA.solved) buildSolved();
  else if (DATA.evaluations.length) buildEpisodes();
}

function buildEpisodes() {
  const section = reveal('tasks');
  const [controls, body] = [section.querySelector('.controls'), section.querySelector('.body')];
  const state = { e: 0, ending: 'all' };
  const plain = (key, title, decimals, hint) => ({ key, title, hint, value: (row) => row[key], cell: (row) => fixed(row[key], decimals) });
  const social = DATA.evaluations.some(({ tasks }) => 'fault' in tasks) ? [
    { key: 'fault', title: 'Fault', text: true, hint: 'who moved into whom', value: (row) => row.fault ?? '', cell: (row) => row.fault ?? '' },
    plain('person_distance_m', 'Nearest person, m', 2), plain('near_person_s', 'Within 0.5 m, s', 1),
    plain('frozen_s', 'Frozen, s', 1), plain('lost_s', 'Lost, s', 1),
  ] : [];
  const table = sortable('Tasks', [
    {
      key: 'task', title: 'Task', value: (row) => row.task,
      cell: (row) => {
        const found = findReplay(DATA.evaluations[state.e], row.task);
        if (found < 0) return String(row.task);
        return el('button', { type: 'button', class: 'link', 'aria-label': `Replay task ${row.task}`, onclick: () => player.select(state.e, found, { scroll: true }) }, `▶ ${row.task}`);
      },
    },
    { key: 'ending', title: 'Ending', text: true, value: (row) => row.ending, cell: (row) => el('span', { class: `ending ${row.ending}` }, row.ending) },
    plain('time_s', 'Time, s', 1), plain('distance_m', 'Driven, m', 1), plain('shortest_m', 'Shortest, m', 1),
    plain('ratio', 'Driven / shortest', 2, 'of arrivals'), plain('clearance_m', 'Least clearance, m', 2), plain('smoothness', 'Yaw accel., rad/s²', 2),
    ...social,
  ], { sort: 'task', tall: true });
  table.element.id = 'tasks-table';
  const count = el('span', { class: 'note small', style: 'margin: 0', role: 'status' });
  const show = () => {
    const { tasks } = DATA.evaluations[state.e];
    const rows = tasks.task.map((_, i) => Object.fromEntries(Object.entries(tasks).map(([key, column]) => [key, column[i]])));
    const chosen = rows.filter((row) => state.ending === 'all' || row.ending === state.ending || (state.ending === 'failures' && row.ending !== 'success'));
    count.textContent = `${chosen.length} of ${rows.length} tasks`;
    table.show(chosen);
  };
  if (DATA.evaluations.length > 1) {
    controls.append(chooser('Evaluation', DATA.evaluations.map((e, i) => [String(i), e.label]), (value) => { state.e = Number(value); show(); }).element);
  }
  const endings = [['all', 'all'], ['failures', 'all failures'], ['collision', 'collisions'], ['timeout', 'timeouts'], ['success', 'successes']];
  controls.append(chooser('Ending', endings, (value) => { state.ending = value; show(); }).element, count);
  body.append(table.element);
  show();
}

/** A comparison's tasks: which share of each method's seeds solved it. */
function buildSolved() {
  const { task, methods } = DATA.solved;
  const section = reveal('tasks');
  const names = Object.keys(methods);
  const mean = (i) => {
    const known = names.map((name) => methods[name][i]).filter((v) => v !== null);
    return known.reduce((a, b) => a + b, 0) / known.length;
  };
  const rows = task.map((number, i) => ({ task: number, mean: mean(i), ...Object.fromEntries(names.map((name, k) => [`m${k}`, methods[name][i]])) }));
  const share = (key, title) => ({
    key, title, value: (row) => row[key], cell: (row) => fixed(row[key], 0),
    style: (row) => (row[key] === null ? null : `background: color-mix(in srgb, var(--bad) ${Math.round(0.55 * (100 - row[key]))}%, transparent)`),
  });
  const table = sortable('Tasks', [
    { key: 'task', title: 'Task', value: (row) => row.task, cell: (row) => String(row.task) },
    share('mean', 'All'), ...names.map((name, k) => share(`m${k}`, name)),
  ], { sort: 'mean', tall: true });
  table.element.id = 'tasks-table';
  section.querySelector('.controls').append(el('p', { class: 'note small', style: 'margin: 0' }, 'Percent of the training seeds that solved the task, hardest tasks first.'));
  section.querySelector('.body').append(table.element);
  table.show(rows);
}

buildHeader();
buildResults();
// Plotly comes last in the file: tables and replays are there while it is read. The navigation keeps the page's order.
buildReplay();
buildGallery();
buildTasks();
window.addEventListener('load', () => {
  buildIntervals(document.querySelector('#results .body'));
  buildCharts();
  buildMap();
  const links = [...document.querySelectorAll('#nav a')];
  const order = [...document.querySelectorAll('main section')].map((section) => `#${section.id}`);
  links.sort((a, b) => order.indexOf(a.getAttribute('href')) - order.indexOf(b.getAttribute('href')));
  document.getElementById('nav').replaceChildren(...links);
  document.documentElement.dataset.ready = 'true';
});
