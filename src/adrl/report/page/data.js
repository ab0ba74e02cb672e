const DATA = JSON.parse(document.getElementById('data').textContent);

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

/** Rows of numbers from what encode.packed made: array(row, column) in real units. */
function unpack({ shape, bits, scale, data }) {
  const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  const integers = bits === 8 ? bytes : new Int16Array(bytes.buffer);
  const columns = shape.length > 1 ? shape[1] : 1;
  const read = (row, column = 0) => integers[row * columns + column] * scale;
  read.rows = shape[0];
  read.columns = columns;
  return read;
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

/** A section that has something to show, and its entry in the navigation. */
function reveal(id) {
  const section = document.getElementById(id);
  section.hidden = false;
  const title = section.querySelector('h2').textContent;
  document.getElementById('nav').append(el('a', { href: `#${id}` }, title));
  return section;
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
