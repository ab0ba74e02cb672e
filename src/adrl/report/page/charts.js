function buildCharts() {
  if (!DATA.charts.length) return;
  const section = reveal('training');
  let axis = 'wall_s';
  const grid = section.querySelector('.charts');
  const cards = DATA.charts.map((chart) => {
    const holder = el('div', { class: 'chart' });
    grid.append(el('div', { class: 'card' }, el('h3', {}, chart.unit ? `${chart.title}, ${chart.unit}` : chart.title), holder));
    return [chart, holder];
  });
  const redraws = cards.map(([chart, holder]) => whenSeen(holder, () => drawChart(holder, chart, axis)));
  section.querySelector('.controls').append(segmented('Axis', Object.entries(AXES), (value) => { axis = value; redraws.forEach((redraw) => redraw()); }));
  if (DATA.kind === 'comparison') {
    section.insertBefore(el('p', { class: 'note small' }, 'Lines are means over training seeds, bands reach from the worst to the best seed. A name in the legend hides or shows its line.'), grid);
  }
}

/** Methods of a comparison with their intervals, best at the top. */
function buildIntervals(parent) {
  const rows = DATA.rows.filter((row) => row.success !== null && row.success_low !== null);
  if (DATA.kind !== 'comparison' || rows.length < 2) return;
  const sorted = [...rows].sort((a, b) => a.success - b.success);
  const height = 90 + 26 * sorted.length;
  const holder = el('div', { class: 'chart', id: 'intervals', style: `height: ${height}px` });
  parent.append(el('div', { class: 'card', style: 'margin-top: .9rem' }, el('h3', {}, 'Success with 95 % intervals, %'), holder));
  const several = new Set(rows.map((row) => row.note.split(',')[0])).size > 1;
  whenSeen(holder, () => Plotly.react(holder, [{
    type: 'scatter', mode: 'markers', hovertemplate: '%{y}: %{x:.1f} %<extra></extra>',
    x: sorted.map((row) => 100 * row.success),
    y: sorted.map((row) => (several ? `${row.label}, ${row.note.split(',')[0]}` : row.label)),
    marker: { size: 9, color: sorted.map((row) => colour(row.label === 'adrl' ? 's1' : 's0')) },
    error_x: {
      type: 'data', symmetric: false, thickness: 1.6, width: 4, color: colour('edge'),
      array: sorted.map((row) => 100 * (row.success_high - row.success)),
      arrayminus: sorted.map((row) => 100 * (row.success - row.success_low)),
    },
  }], baseLayout({
    height, hovermode: 'closest', margin: { l: 20, r: 14, t: 6, b: 34 },
    xaxis: { ticksuffix: ' %' }, yaxis: { type: 'category', showgrid: false },
  }), CONFIG));
}

const MEASURES = [['share', 'failures of those who passed'], ['collided', 'collisions here'], ['passed', 'traffic']];

function buildMap() {
  const known = DATA.evaluations.filter((evaluation) => evaluation.map);
  if (!known.length) return;
  const section = reveal('map');
  const [controls, body] = [section.querySelector('.controls'), section.querySelector('.body')];
  const state = { evaluation: known[0], measure: 'share', tasks: false };
  const holder = el('div', { class: 'chart', id: 'failure-map' });
  const note = el('p', { class: 'note small' });
  body.append(note, el('div', { class: 'card' }, holder));
  if (known.length > 1) {
    controls.append(chooser('Evaluation', known.map((e, i) => [String(i), e.label]), (value) => { state.evaluation = known[Number(value)]; draw(); }).element);
  }
  controls.append(chooser('Show', MEASURES, (value) => { state.measure = value; draw(); }).element);
  const lines = el('button', { type: 'button', class: 'button', 'aria-pressed': 'false', onclick: () => {
    state.tasks = !state.tasks;
    lines.setAttribute('aria-pressed', String(state.tasks));
    draw();
  } }, 'Start → goal of failed tasks');
  controls.append(lines);
  layOutMap(holder, note, state.evaluation);
  let listens = false;
  const draw = whenSeen(holder, () => {
    drawMap(holder, note, state);
    if (listens) return;
    listens = true;
    holder.on('plotly_click', ({ points: [point] }) => {
      const found = findReplay(state.evaluation, point.customdata);
      if (point.data.type === 'scatter' && found >= 0) player.select(DATA.evaluations.indexOf(state.evaluation), found, { scroll: true });
    });
  });
}

/** Room and words for the map of an evaluation, before it is drawn: what is drawn when it is seen moves nothing on the page. Returns its height. */
function layOutMap(holder, note, evaluation) {
  const { window: [left, bottom, right, top], cell_m: cell } = evaluation.map;
  note.textContent = `${evaluation.label}: ${evaluation.policy} on ${evaluation.scenario}, ${evaluation.tasks.task.length} tasks, cells of ${cell.toFixed(2)} m. `
    + 'A cell that few episodes crossed says little: hover for the counts. A marked failure that has a replay opens it when clicked.';
  const width = holder.clientWidth || 600;
  const height = Math.min(760, Math.max(300, width * Math.min(1.3, (top - bottom) / (right - left)))) + 90;
  holder.style.height = `${height}px`;
  return height;
}

function drawMap(holder, note, { evaluation, measure, tasks }) {
  const height = layOutMap(holder, note, evaluation);
  const { bounds: [x0, y0, x1, y1], window: [left, bottom, right, top], cell_m: cell, origin, passed, failed, collided, ends, picture } = evaluation.map;
  const value = { share: (r, c) => 100 * failed[r][c] / passed[r][c], collided: (r, c) => collided[r][c] || null, passed: (r, c) => passed[r][c] }[measure];
  const z = passed.map((row, r) => row.map((count, c) => (count ? value(r, c) : null)));
  const text = passed.map((row, r) => row.map((count, c) => (count ? `${failed[r][c]} of ${count} episodes through here failed, ${collided[r][c]} collided here` : '')));
  const centres = (from, count) => Array.from({ length: count }, (_, i) => from + (i + 0.5) * cell);
  const most = measure === 'share' ? 100 : undefined;
  const [low, high] = [translucent(colour('bad')), colour(measure === 'passed' ? 's0' : 'bad')];
  const traces = [{
    type: 'heatmap', z, text, hovertemplate: '%{text}<extra></extra>', zmin: 0, zmax: most, opacity: 0.85,
    x: centres(origin[0], passed[0].length), y: centres(origin[1], passed.length),
    colorscale: [[0, measure === 'passed' ? translucent(colour('s0')) : low], [1, high]],
    colorbar: { thickness: 10, outlinewidth: 0, ticksuffix: measure === 'share' ? ' %' : '', orientation: 'h', y: -0.04, yanchor: 'top', len: 0.6, x: 0, xanchor: 'left' },
  }];
  if (tasks) {
    const path = (points) => points.flatMap(([a, b]) => [a, b, null]);
    traces.push({
      mode: 'lines', hoverinfo: 'skip', line: { color: colour('muted'), width: 1, dash: 'dot' }, showlegend: false,
      x: path(ends.start.map((s, i) => [s[0], ends.goal[i][0]])), y: path(ends.start.map((s, i) => [s[1], ends.goal[i][1]])),
    }, {
      mode: 'markers', hoverinfo: 'skip', marker: { symbol: 'circle-open', size: 7, color: colour('goal') }, name: 'their goals',
      x: ends.goal.map((p) => p[0]), y: ends.goal.map((p) => p[1]),
    });
  }
  for (const [ending, symbol] of [['collision', 'x'], ['timeout', 'square-open']]) {
    const at = ends.end.map((_, i) => i).filter((i) => ends.ending[i] === ending);
    if (!at.length) continue;
    traces.push({
      mode: 'markers', name: `${ending} (${at.length})`, marker: { symbol, size: 9, color: colour('ink'), line: { width: 1.5, color: colour('ink') } },
      x: at.map((i) => ends.end[i][0]), y: at.map((i) => ends.end[i][1]), customdata: at.map((i) => ends.task[i]),
      hovertemplate: `task %{customdata}: ${ending}<extra></extra>`,
    });
  }
  Plotly.react(holder, traces, baseLayout({
    height, hovermode: 'closest', margin: { l: 34, r: 8, t: 26, b: 30 }, showlegend: true,
    images: [{ source: picture, xref: 'x', yref: 'y', x: x0, y: y1, sizex: x1 - x0, sizey: y1 - y0, sizing: 'stretch', layer: 'below', opacity: Number(colour('picture')) }],
    xaxis: { range: [left, right], showgrid: false, zeroline: false, constrain: 'domain', ticksuffix: ' m' },
    yaxis: { range: [bottom, top], showgrid: false, zeroline: false, scaleanchor: 'x', constrain: 'domain' },
  }), CONFIG);
}
