function baseLayout(extra = {}) {
  const axis = { gridcolor: colour('grid'), zerolinecolor: colour('line'), linecolor: colour('line'), automargin: true };
  const { xaxis = {}, yaxis = {}, ...rest } = extra;
  return {
    paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)',
    font: { color: colour('muted'), size: 12, family: 'system-ui, "DejaVu Sans", sans-serif' },
    margin: { l: 46, r: 12, t: 8, b: 40 },
    hovermode: 'x unified', hoverlabel: { bgcolor: colour('surface'), bordercolor: colour('line'), font: { color: colour('ink') } },
    legend: { orientation: 'h', y: 1.02, yanchor: 'bottom', x: 0, font: { size: 11 } },
    // On a touch screen a finger on a chart scrolls the page.
    dragmode: matchMedia('(pointer: coarse)').matches ? false : 'zoom',
    xaxis: { ...axis, ...xaxis }, yaxis: { ...axis, ...yaxis },
    ...rest,
  };
}
const CONFIG = { responsive: true, displayModeBar: false };
const translucent = (css) => `rgba(${[1, 3, 5].map((i) => parseInt(css.slice(i, i + 2), 16)).join(',')},0.14)`;
const AXES = { wall_s: 'wall clock, s', env_steps: 'environment steps' };

function drawChart(holder, chart, axis) {
  const traces = [];
  chart.series.forEach((series, index) => {
    const data = series[axis];
    if (!data) return;
    const line = { color: seriesColour(index), width: 2, dash: DASHES[Math.floor(index / SERIES) % DASHES.length] };
    const group = `${index}`;
    if (data.low) {
      const edge = { x: data.x, mode: 'lines', line: { width: 0 }, hoverinfo: 'skip', showlegend: false, legendgroup: group };
      traces.push({ ...edge, y: data.low }, { ...edge, y: data.high, fill: 'tonexty', fillcolor: translucent(seriesColour(index)) });
    }
    const few = data.x.length <= 40 && !data.low;
    traces.push({ x: data.x, y: data.y, name: series.name, mode: few ? 'lines+markers' : 'lines', line, marker: { size: 5 }, legendgroup: group });
  });
  const layout = baseLayout({
    xaxis: { title: { text: AXES[axis], font: { size: 11 }, standoff: 8 }, rangemode: 'tozero' },
    yaxis: chart.unit === '%' ? { range: [-3, 103] } : {},
    showlegend: chart.series.length > 1,
    uirevision: axis, // what a person has zoomed to stays while the curves grow
  });
  Plotly.react(holder, traces, layout, CONFIG);
}
