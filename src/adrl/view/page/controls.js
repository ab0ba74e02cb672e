const OTHER = '\u2026';
const BY_HAND = 'by hand';
const SLOWEST = 0.1;
const FASTEST = 20;

/**
 * The server's word in a control. It takes nothing away from a person: it waits while the control has the focus, and while
 * something else is chosen there than it said before. read(): what is chosen; show(value, names). Returns say(value, names).
 */
function spoken(nodes, { read, show }) {
  let said = null;
  return (value, names) => {
    const word = String(value);
    if (read() === word) said = word; // it has become what was chosen
    if ((said !== null && read() !== said) || nodes.includes(document.activeElement)) return;
    show(word, names);
    said = word;
  };
}

/** Replaces the options of a drop-down where they are others. */
function offerOptions(select, options) {
  if (JSON.stringify(options) === select.dataset.options) return;
  select.dataset.options = JSON.stringify(options);
  select.replaceChildren(...options.map(([value, text]) => el('option', { value }, text)));
}

/** A whole number. */
function counter(label, id, most) {
  const input = el('input', { type: 'number', id, min: 0, max: most, step: 1 });
  const read = () => String(Math.max(0, Math.round(Number(input.value) || 0)));
  return {
    element: el('label', {}, label, input),
    say: spoken([input], { read, show: (word) => { input.value = word; } }),
    get value() { return Number(read()); },
  };
}

/** A drop-down of names, and one of one's own where a file or folder will do. */
function picker(label, id, { other = null, none = null } = {}) {
  const select = el('select', { id });
  const text = el('input', { type: 'text', 'aria-label': `${label}: ${other}`, placeholder: other, hidden: true, spellcheck: 'false' });
  const element = el('label', {}, label, select, text);
  select.addEventListener('change', () => { text.hidden = select.value !== OTHER; if (!text.hidden) text.focus(); });
  const own = () => select.value === OTHER;
  const say = spoken([select, text], {
    read: () => (own() ? text.value.trim() || OTHER : select.value),
    show(value, names) {
      const known = names.includes(value) || (none !== null && value === '') ? names : [...names, value];
      offerOptions(select, [
        ...(none === null ? [] : [['', none]]), ...known.map((name) => [name, name]), ...(other === null ? [] : [[OTHER, `${other} ${OTHER}`]]),
      ]);
      select.value = value;
      text.hidden = true;
    },
  });
  return { element, say, get value() { return own() ? text.value.trim() : select.value; } };
}

function buildChoices() {
  const policy = picker('Policy', 'policy', { other: 'run folder or file' });
  const second = picker('Beside it', 'second', { none: 'nobody', other: 'run folder or file' });
  const robot = picker('Robot', 'robot', { none: "the policy's own", other: 'TOML file' });
  const place = picker('Place', 'place-choice', { other: 'map, world or folder' });
  const guidance = picker('Guidance', 'guidance', { none: 'as trained' });
  const people = counter('More people', 'people', 64);
  const task = counter('Task', 'task', null);
  const start = el('button', { type: 'submit', class: 'button primary', id: 'start' }, 'Start');
  const choose = (changes = {}) => ask({
    do: 'choose', policies: [policy.value, second.value].filter(Boolean), robot: robot.value, place: place.value,
    guidance: guidance.value, task: task.value, people: people.value, ...changes,
  });
  const form = el('form', { class: 'choices', onsubmit: (event) => { event.preventDefault(); choose(); } },
    policy.element, second.element, robot.element, place.element, guidance.element,
    people.element, task.element, start);
  document.getElementById('choices').append(form);
  return {
    choose,
    fill({ offer, choice }) {
      policy.say(choice.policies[0], offer.policies);
      second.say(choice.policies[1] ?? '', offer.policies);
      robot.say(choice.robot, offer.robots);
      place.say(choice.place, offer.places);
      guidance.say(choice.guidance, offer.guidance);
      people.say(choice.people);
      task.say(choice.task);
    },
  };
}

function buildTransport(choices) {
  const state = { playing: true, speed: 1 };
  const pace = (changes) => ask({ do: 'pace', ...changes });
  const play = el('button', { type: 'button', class: 'button primary', id: 'play', onclick: () => pace({ playing: !state.playing }) }, '❚❚ Pause');
  const restart = el('button', { type: 'button', class: 'button', id: 'restart', 'data-for': 'drive', onclick: () => ask({ do: 'restart' }) }, '↺ Restart');
  const next = el('button', { type: 'button', class: 'button', id: 'next', 'data-for': 'drive', onclick: () => choices.choose({ ...link.setup.choice, do: 'choose', task: link.setup.choice.task + 1 }) }, 'Next task ›');
  const scrub = el('input', { type: 'range', id: 'scrub', 'data-for': 'recording', min: 0, step: 0.1, 'aria-label': 'Time in the recording', oninput: () => ask({ do: 'seek', time_s: Number(scrub.value) }) });
  // The slider is the logarithm: as far from 0.1 to 1 as from 2 to 20.
  const slider = el('input', { type: 'range', id: 'speed', min: Math.log(SLOWEST), max: Math.log(FASTEST), step: 'any', 'aria-label': 'Speed', oninput: () => pace({ speed: rounded(Math.exp(Number(slider.value))) }) });
  slider.addEventListener('keydown', (event) => {
    const way = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
    if (!way) return;
    event.preventDefault();
    const speed = rounded(Math.exp(Number(slider.value)) * 1.25 ** way); // of the slider: what the server says may be older
    slider.value = Math.log(speed);
    pace({ speed });
  });
  const told = el('output', { for: 'speed', id: 'pace' });
  const follow = el('button', { type: 'button', class: 'button', id: 'follow', onclick: () => {
    stage.follow = !stage.follow;
    remembered.set('follow', stage.follow);
    show(state);
    stage.lanes.forEach((lane) => lane.redraw());
  } }, 'Follow the robot');
  document.getElementById('transport').append(play, restart, next, scrub, el('label', { for: 'speed' }, 'Speed'), slider, told, follow);
  function rounded(speed) {
    const near = Math.min(FASTEST, Math.max(SLOWEST, speed));
    return Math.abs(near - 1) < 0.08 ? 1 : Number(near.toPrecision(2));
  }
  function show({ playing, speed, reached, time_s: now, duration_s: end }) {
    Object.assign(state, { playing, speed });
    play.textContent = playing ? '❚❚ Pause' : '▶ Play';
    if (document.activeElement !== slider) slider.value = Math.log(speed);
    const slow = playing && reached < 0.8 * speed ? `, this machine does ${fixed(reached)}` : '';
    told.textContent = `${fixed(speed, speed < 1 ? 2 : 1)} × real time${slow}`;
    slider.setAttribute('aria-valuetext', told.textContent);
    follow.setAttribute('aria-pressed', String(Boolean(stage.follow)));
    if (end !== undefined) {
      scrub.max = end;
      if (document.activeElement !== scrub) scrub.value = now;
      scrub.setAttribute('aria-valuetext', `${fixed(now)} seconds of ${fixed(end)}`);
      told.textContent += ` · ${fixed(now)} of ${fixed(end)} s`;
    }
  }
  return { show };
}

function buildPlace() {
  const pillar = el('button', { type: 'button', class: 'button', id: 'pillar', onclick: () => {
    if (!stage.lanes[0].now) return;
    const [x, y, yaw] = stage.lanes[0].now.pose;
    ask({ do: 'pillar', x: x + 1.2 * Math.cos(yaw), y: y + 1.2 * Math.sin(yaw) });
  } }, 'Put a pillar before the robot');
  const person = el('button', { type: 'button', class: 'button', id: 'person', onclick: () => {
    const lane = stage.lanes[0];
    if (!lane.now) return;
    const [x, y] = lane.now.goal ?? lane.now.pose;
    ask({ do: 'person', x, y });
  } }, 'Let a person come from the goal');
  document.getElementById('place').append(el('div', { class: 'controls' }, pillar, person), el('p', { class: 'note small' },
    'Click for a goal, drag an obstacle. By keyboard: Tab to the picture, arrows move the crosshair, ', el('kbd', {}, 'Enter'), ' sets the goal, ',
    el('kbd', {}, 'Space'), ' takes or drops an obstacle, ', el('kbd', {}, 'P'), ' puts a pillar, ', el('kbd', {}, 'O'), ' lets a person walk from there.'));
}

function buildFaults() {
  const buttons = new Map();
  const select = el('select', { id: 'fault', 'aria-label': 'What goes wrong', onchange: () => ask({ do: 'fault', name: select.value }) });
  const quick = el('div', { class: 'controls' });
  document.getElementById('faults').append(quick, el('label', { class: 'stacked' }, 'Any of them, until another is chosen', select), el('p', { class: 'note small', style: 'margin-top: .6rem' },
    'As in adrl bench faults. What the supervisor says of it stands below the picture.'));
  return {
    fill({ faults, quick_faults: named }) {
      offerOptions(select, faults.map((name) => [name, name]));
      Object.entries(named).filter(([, name]) => !buttons.has(name)).forEach(([text, name]) => {
        const button = el('button', { type: 'button', class: 'button', 'aria-pressed': 'false', onclick: () => ask({ do: 'fault', name: button.getAttribute('aria-pressed') === 'true' ? 'none' : name }) }, text);
        buttons.set(name, button);
        quick.append(button);
      });
    },
    show(fault) {
      if (document.activeElement !== select) select.value = fault;
      buttons.forEach((button, name) => button.setAttribute('aria-pressed', String(name === fault)));
    },
  };
}

function buildWheel(choices) {
  const wheel = el('button', { type: 'button', class: 'button', id: 'take-wheel', onclick: () => {
    const byHand = link.setup.by_hand;
    const others = link.setup.choice.policies.filter((name) => name !== BY_HAND);
    choices.choose({ ...link.setup.choice, policies: byHand ? [others[0] ?? 'default'] : [BY_HAND] });
  } });
  const record = el('button', { type: 'button', class: 'button', id: 'record', onclick: () => ask({ do: 'record', on: record.getAttribute('aria-pressed') !== 'true' }) }, 'Record');
  const save = el('button', { type: 'button', class: 'button', id: 'save', onclick: () => ask({ do: 'save' }) }, 'Save');
  const told = el('p', { class: 'note small', id: 'recorded', role: 'status' });
  const padding = el('div', {});
  buildHand(padding);
  document.getElementById('wheel').append(el('div', { class: 'controls' }, wheel, record, save), el('div', { class: 'wheel' }, padding, el('div', {},
    el('p', { class: 'note small' }, el('kbd', {}, 'W'), ' ', el('kbd', {}, 'A'), ' ', el('kbd', {}, 'S'), ' ', el('kbd', {}, 'D'), ', a gamepad, or the pad. ', el('kbd', {}, 'Shift'), ' drives at half speed.'), told)));
  return {
    fill({ by_hand: byHand }) {
      wheel.textContent = byHand ? 'Let the policy drive' : 'Take the wheel';
      wheel.setAttribute('aria-pressed', String(byHand));
      record.disabled = !byHand;
      padding.hidden = !byHand;
    },
    show({ on, steps, episodes, arrivals, saved }) {
      record.setAttribute('aria-pressed', String(on));
      record.className = on ? 'button recording' : 'button';
      save.disabled = steps === 0;
      const counts = steps ? `${steps} steps, ${episodes} episodes, ${arrivals} arrivals. ` : '';
      const where = saved.length ? `Saved: ${saved.at(-1)}. Train with it: adrl train --dataset ${saved.at(-1)}` : '';
      const text = counts + where;
      if (told.textContent !== text) told.textContent = text;
    },
  };
}
