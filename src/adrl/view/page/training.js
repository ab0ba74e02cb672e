const training = { axis: 'wall_s', charts: [], holders: new Map(), plotly: null };

/** Plotly is loaded where there is something to draw with it. */
function loadPlotly() {
  training.plotly ??= new Promise((resolve) => { document.head.append(el('script', { src: 'plotly.js', onload: resolve })); });
  return training.plotly;
}

function buildTraining() {
  document.querySelector('#training .controls').append(segmented('Axis', Object.entries(AXES), (axis) => { training.axis = axis; drawTraining(); }));
  themeListeners.push(drawTraining);
}

async function drawTraining() {
  document.getElementById('training').hidden = !training.charts.length;
  if (!training.charts.length) return;
  await loadPlotly();
  const grid = document.querySelector('#training .charts');
  training.charts.forEach((chart) => {
    if (!training.holders.has(chart.title)) {
      const holder = el('div', { class: 'chart' });
      training.holders.set(chart.title, holder);
      grid.append(el('div', { class: 'card' }, el('h3', {}, chart.unit ? `${chart.title}, ${chart.unit}` : chart.title), holder));
    }
    drawChart(training.holders.get(chart.title), chart, training.axis);
  });
}

link.listeners.push({
  setup: ({ charts = [] }) => { training.charts = charts; drawTraining(); },
  frame: ({ charts }) => { if (charts) { training.charts = charts; drawTraining(); } },
});
