const DATA = JSON.parse(document.getElementById('data').textContent);

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

/** A section that has something to show, and its entry in the navigation. */
function reveal(id) {
  const section = document.getElementById(id);
  section.hidden = false;
  const title = section.querySelector('h2').textContent;
  document.getElementById('nav').append(el('a', { href: `#${id}` }, title));
  return section;
}
