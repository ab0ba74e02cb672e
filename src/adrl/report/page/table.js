/**
 * A table whose columns sort: columns are {key, title, text, cell(row), value(row)}; what has no value goes last.
 * Returns its element and show(rows), which replaces the rows and keeps the order asked for.
 */
function sortable(label, columns, { sort = null, descending = false, tall = false } = {}) {
  let order = { key: sort, descending };
  let rows = [];
  const body = el('tbody');
  const heads = columns.map((column) => {
    const button = el('button', { type: 'button', onclick: () => toggle(column) }, column.title);
    return el('th', { scope: 'col', class: column.text ? 'text' : null, title: column.hint }, button);
  });
  const table = el('table', {}, el('thead', {}, el('tr', {}, ...heads)), body);

  function toggle(column) {
    // Names begin with A, numbers with the largest; the second press turns it round.
    const first = !column.text;
    order = { key: column.key, descending: order.key === column.key ? !order.descending : first };
    draw();
  }

  function compare(a, b, column) {
    const [x, y] = [column.value(a), column.value(b)];
    const missing = (v) => v === null || v === undefined;
    if (missing(x) || missing(y)) return missing(x) - missing(y);
    const sign = typeof x === 'string' ? x.localeCompare(y, undefined, { numeric: true }) : x - y;
    return order.descending ? -sign : sign;
  }

  function draw() {
    const chosen = columns.find((column) => column.key === order.key);
    const sorted = chosen ? [...rows].sort((a, b) => compare(a, b, chosen)) : rows;
    heads.forEach((head, i) => {
      const state = order.descending ? 'descending' : 'ascending';
      head.setAttribute('aria-sort', columns[i] === chosen ? state : 'none');
    });
    body.replaceChildren(...sorted.map((row) => el('tr', {}, ...columns.map((column, i) => {
      const content = column.cell(row);
      const attributes = { class: column.text ? 'text' : null, style: column.style?.(row) };
      if (i === 0) attributes.scope = 'row';
      return el(i === 0 ? 'th' : 'td', attributes, ...(Array.isArray(content) ? content : [content]));
    }))));
  }

  const element = el('div', { class: tall ? 'scroll tall' : 'scroll', role: 'region', tabindex: '0', 'aria-label': label }, table);
  return { element, show: (content) => { rows = content; draw(); } };
}

/** A column of a metric, with its interval below where there is one. */
function metric(key, title, decimals, scale = 1, hint = null) {
  return {
    key, title, hint,
    value: (row) => row[key],
    cell: (row) => {
      const [low, high] = [row[`${key}_low`], row[`${key}_high`]];
      const known = low !== null && low !== undefined && high !== null && high !== undefined;
      const range = known ? el('span', { class: 'range' }, `${fixed(low, decimals, scale)} – ${fixed(high, decimals, scale)}`) : null;
      return [fixed(row[key], decimals, scale), range].filter(Boolean);
    },
  };
}
