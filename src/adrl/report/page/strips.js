/**
 * A small chart over an episode's time with a cursor; drag it to move in time.
 * series: [{name, colour: index, value(frame)}]; stacked: areas that sum to the whole.
 */
function strip(title, unit, { stacked = false, onSeek }) {
  const canvas = el('canvas', { class: 'strip', 'aria-hidden': 'true' });
  const legend = el('ul', { class: 'legend' });
  const element = el('div', { class: 'card' }, el('h3', {}, title), canvas, legend);
  let replay = null;
  let series = [];
  let time = 0;
  let outputs = [];

  const PAD = { left: 34, right: 6, top: 8, bottom: 16 };
  const span = (width) => width - PAD.left - PAD.right;

  function range() {
    if (stacked) return [0, 1];
    let [low, high] = [0, 0];
    series.forEach(({ value }) => replay.time_s.forEach((_, i) => {
      low = Math.min(low, value(i));
      high = Math.max(high, value(i));
    }));
    return high - low < 1e-9 ? [low - 0.5, high + 0.5] : [low, high + 0.04 * (high - low)];
  }

  const redraw = sharp(canvas, (context, width, height) => {
    if (!replay?.time_s.length) return;
    const [low, high] = range();
    const begin = replay.time_s[0];
    const end = Math.max(replay.time_s.at(-1), begin + 0.01);
    const x = (t) => PAD.left + ((t - begin) / (end - begin)) * span(width);
    const y = (v) => height - PAD.bottom - ((v - low) / (high - low)) * (height - PAD.top - PAD.bottom);
    context.font = '11px system-ui, "DejaVu Sans", sans-serif';
    context.fillStyle = colour('muted');
    context.strokeStyle = colour('grid');
    context.textAlign = 'right';
    context.textBaseline = 'middle';
    for (const tick of stacked ? [0, 0.5, 1] : [low, 0, high].filter((v, i, all) => all.indexOf(v) === i)) {
      if (tick !== 0 && !stacked && Math.abs(y(tick) - y(0)) < 12) continue;
      context.fillText(tick.toFixed(Math.abs(tick) >= 10 || tick === 0 ? 0 : 1), PAD.left - 5, y(tick));
      context.beginPath();
      context.moveTo(PAD.left, y(tick));
      context.lineTo(width - PAD.right, y(tick));
      context.stroke();
    }
    context.textAlign = 'left';
    context.textBaseline = 'alphabetic';
    context.fillText(`${fixed(begin, begin === 0 ? 0 : 1)} s`, PAD.left, height - 3);
    context.textAlign = 'right';
    context.fillText(`${end.toFixed(1)} s`, width - PAD.right, height - 3);
    (stacked ? drawAreas : drawLines)(context, x, y);
    context.strokeStyle = colour('ink');
    context.lineWidth = 1.2;
    context.beginPath();
    context.moveTo(x(time), PAD.top - 3);
    context.lineTo(x(time), height - PAD.bottom);
    context.stroke();
  });

  function drawAreas(context, x, y) {
    const base = replay.time_s.map(() => 0);
    series.forEach(({ value, index }) => {
      const top = base.map((b, i) => b + value(i));
      context.fillStyle = seriesColour(index);
      context.globalAlpha = 0.75;
      context.beginPath();
      replay.time_s.forEach((t, i) => context.lineTo(x(t), y(top[i])));
      for (let i = base.length - 1; i >= 0; i -= 1) context.lineTo(x(replay.time_s[i]), y(base[i]));
      context.closePath();
      context.fill();
      context.globalAlpha = 1;
      top.forEach((v, i) => { base[i] = v; });
    });
  }

  function drawLines(context, x, y) {
    context.lineJoin = 'round';
    series.forEach(({ value, index }) => {
      context.strokeStyle = seriesColour(index);
      context.lineWidth = 1.8;
      context.beginPath();
      replay.time_s.forEach((t, i) => context.lineTo(x(t), y(value(i))));
      context.stroke();
    });
  }

  const seek = (event) => {
    if (!replay || (event.type === 'pointermove' && !event.buttons)) return;
    const box = canvas.getBoundingClientRect();
    const part = (event.clientX - box.left - PAD.left) / span(box.width);
    const [begin, end] = [replay.time_s[0], replay.time_s.at(-1)];
    onSeek(begin + Math.min(1, Math.max(0, part)) * (end - begin));
  };
  canvas.addEventListener('pointerdown', seek);
  canvas.addEventListener('pointermove', seek);

  function open(next, content) {
    replay = next;
    series = content;
    outputs = series.map(() => el('b', {}));
    legend.replaceChildren(...series.map(({ name, index }, i) => el(
      'li', {}, el('span', { class: 'swatch', style: `background: var(--s${index % SERIES})` }), `${name} `, outputs[i], ` ${unit[i] ?? ''}`,
    )));
  }

  function at(now) {
    time = now;
    const { frame } = frameAt(replay, now);
    series.forEach(({ value, decimals }, i) => { outputs[i].textContent = fixed(value(frame), decimals ?? 2); });
    redraw();
  }
  return { element, open, at };
}
