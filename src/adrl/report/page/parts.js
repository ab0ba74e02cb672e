/** An element with attributes (onclick and the like as functions) and children, text or elements. */
function el(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith('on')) node.addEventListener(name.slice(2), value);
    else if (name === 'style') node.style.cssText = value;
    else node.setAttribute(name, value === true ? '' : value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

/** Flat numbers as groups: [1, 2, 3, 4] by 2 is [[1, 2], [3, 4]]. */
function groups(flat, size) {
  return Array.from({ length: flat.length / size }, (_, i) => flat.slice(i * size, (i + 1) * size));
}

function fixed(value, decimals = 1, scale = 1) {
  if (value === null || value === undefined) return '–';
  return (value * scale).toFixed(decimals).replace(/^-(0(\.0*)?)$/, '$1'); // no -0.00
}

const palette = new Map();
/** A colour of the style sheet, light or dark. */
function colour(name) {
  if (!palette.has(name)) palette.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return palette.get(name);
}
const SERIES = 7;
const DASHES = ['solid', 'dash', 'dot', 'dashdot', 'longdash'];
const seriesColour = (index) => colour(`s${index % SERIES}`);

const themeListeners = [];

/**
 * Draws an element once it is near the window, and whenever light turns dark; nothing is drawn for nobody.
 * Returns a function that draws it again, if it is seen, or when it comes to be.
 */
function whenSeen(element, draw) {
  let near = false;
  const redraw = () => { if (near) draw(); };
  new IntersectionObserver((entries) => {
    const was = near;
    near = entries.at(-1).isIntersecting;
    if (near && !was) draw();
  }, { rootMargin: '400px' }).observe(element);
  window.addEventListener('beforeprint', () => { near = true; draw(); });
  themeListeners.push(redraw);
  return redraw;
}
function themeChanged() {
  palette.clear();
  themeListeners.forEach((draw) => draw());
}

/** The button that switches between light and dark; the system's own choice until it is pressed. */
function buildTheme() {
  document.getElementById('theme').addEventListener('click', () => {
    const root = document.documentElement;
    const dark = root.dataset.theme ? root.dataset.theme === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
    root.dataset.theme = dark ? 'light' : 'dark';
    themeChanged();
  });
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', themeChanged);
}

/** A canvas made sharp for the screen: calls draw(context, width, height) in CSS pixels, and again when it is resized. */
function sharp(canvas, draw) {
  const redraw = whenSeen(canvas, () => {
    const { width, height } = canvas.getBoundingClientRect();
    if (!width || !height) return;
    const ratio = window.devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const context = canvas.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    draw(context, width, height);
  });
  new ResizeObserver(redraw).observe(canvas);
  return redraw;
}

/** A labelled drop-down of [value, text] pairs, or of groups [name, pairs]. */
function chooser(label, options, onchange) {
  const select = el('select', { onchange: () => onchange(select.value) });
  const add = (parent, pairs) => pairs.forEach(([value, text]) => parent.append(el('option', { value }, text)));
  options.forEach((entry) => {
    if (Array.isArray(entry[1])) {
      const group = el('optgroup', { label: entry[0] });
      add(group, entry[1]);
      select.append(group);
    } else add(select, [entry]);
  });
  return { element: el('label', { class: 'field' }, label, select), select };
}

/** Buttons of which one is pressed. */
function segmented(label, options, onchange) {
  const buttons = options.map(([value, text], index) => el('button', {
    type: 'button',
    'aria-pressed': index === 0 ? 'true' : 'false',
    onclick: () => {
      buttons.forEach((button, i) => button.setAttribute('aria-pressed', options[i][0] === value ? 'true' : 'false'));
      onchange(value);
    },
  }, text));
  return el('div', { class: 'segmented', role: 'group', 'aria-label': label }, ...buttons);
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
