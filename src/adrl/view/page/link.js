const RETRY_MS = 1000;
const MOST_ROWS = 4000;
const GONE = 'The server does not answer, and the drive stands still. This page goes on when it is back. If you start adrl view again, open the address that it prints.';

/**
 * The line to the server. It comes back by itself. listeners: setup(content, again), frame(content); again: the same drive is told anew.
 * send(message): whether it could be sent.
 */
const link = { listeners: [], send: () => false, setup: null };

function connect() {
  const line = new WebSocket(`ws://${location.host}${location.pathname}live`);
  let version = null;
  link.send = (message) => {
    const open = line.readyState === WebSocket.OPEN;
    if (open) line.send(JSON.stringify(message));
    return open;
  };
  line.onopen = () => { say(''); setLink('live', 'live'); };
  line.onmessage = ({ data }) => {
    const content = JSON.parse(data);
    if (content.setup) {
      waiting = null;
      const again = content.setup.version === version;
      version = content.setup.version;
      link.setup = content.setup;
      link.listeners.forEach(({ setup }) => setup?.(content.setup, again));
    } else {
      if (content.errors) say(content.errors.join('\n'));
      if (link.setup && content.lanes) later(content);
    }
  };
  line.onclose = () => {
    setLink('gone', 'no server');
    say(GONE);
    setTimeout(connect, RETRY_MS);
  };
}

let waiting = null;

/** A page that is slower than its server draws what is newest, and loses none of the rows. */
function later(frame) {
  if (!waiting) {
    requestAnimationFrame(() => {
      const newest = waiting;
      waiting = null;
      if (newest) link.listeners.forEach((listener) => listener.frame?.(newest));
    });
    waiting = frame;
    return;
  }
  const lanes = frame.lanes.map((lane, i) => ({ ...waiting.lanes[i], ...lane, rows: [...(waiting.lanes[i]?.rows ?? []), ...lane.rows].slice(-MOST_ROWS) }));
  waiting = { ...waiting, ...frame, lanes };
}

function setLink(state, text) {
  const element = document.getElementById('link');
  element.dataset.state = state;
  element.textContent = text;
}

/** What went wrong, or nothing; an error stays until something else is asked for. */
function say(text) {
  const banner = document.getElementById('banner');
  banner.textContent = text;
  banner.hidden = !text;
}

function ask(message) {
  if (link.send(message)) say('');
}

/** What this tab remembers across a reload; the rest is the server's. */
const remembered = {
  get: (name, otherwise) => { const text = sessionStorage.getItem(name); return text === null ? otherwise : JSON.parse(text); },
  set: (name, value) => sessionStorage.setItem(name, JSON.stringify(value)),
};
