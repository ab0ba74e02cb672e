const TELLS_MS = 100;
const DEAD_ZONE = 0.12;
const KEYS = { KeyW: [1, 0], KeyS: [-1, 0], KeyA: [0, 1], KeyD: [0, -1] };
const ARROWS = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1] };

const hand = { held: new Map(), pad: [0, 0], last: [0, 0] };
const typing = () => document.activeElement?.matches('input, select, textarea');

function buildHand(parent) {
  const knob = el('span', {});
  const pad = el('div', { class: 'pad', id: 'pad', tabindex: 0, role: 'application', 'aria-label': 'Steering pad: drag, or use the arrow keys' }, knob);
  const show = ([speed, turn]) => { knob.style.transform = `translate(${-turn * 45}%, ${-speed * 45}%)`; };
  const follow = (event) => {
    const box = pad.getBoundingClientRect();
    const share = (at, from, size) => Math.min(1, Math.max(-1, (at - from - size / 2) / (0.4 * size)));
    hand.pad = [-share(event.clientY, box.top, box.height), -share(event.clientX, box.left, box.width)];
  };
  pad.addEventListener('pointerdown', (event) => { pad.setPointerCapture(event.pointerId); follow(event); });
  pad.addEventListener('pointermove', (event) => { if (pad.hasPointerCapture(event.pointerId)) follow(event); });
  for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) pad.addEventListener(end, () => { hand.pad = [0, 0]; });
  document.addEventListener('keydown', (event) => {
    const way = KEYS[event.code] ?? (document.activeElement === pad ? ARROWS[event.code] : null);
    if (!way || typing() || event.ctrlKey || event.metaKey || event.altKey || !stage.setup?.by_hand) return;
    hand.held.set(event.code, way.map((part) => (event.shiftKey ? 0.5 * part : part)));
    event.preventDefault();
  });
  document.addEventListener('keyup', (event) => hand.held.delete(event.code));
  window.addEventListener('blur', () => hand.held.clear());
  setInterval(() => {
    const wanted = wish();
    show(wanted);
    const still = wanted.every((part) => part === 0) && hand.last.every((part) => part === 0);
    if (stage.setup?.by_hand && !still) link.send({ do: 'hand', speed: wanted[0], turn: wanted[1] });
    hand.last = wanted;
  }, TELLS_MS);
  parent.append(pad);
}

/** Speed and turn in [-1, 1]: of keys, pad and gamepad, whichever says most. */
function wish() {
  const sum = [0, 0];
  hand.held.forEach(([speed, turn]) => { sum[0] += speed; sum[1] += turn; });
  const pads = (navigator.getGamepads?.() ?? []).filter(Boolean).map(({ axes }) => [-axes[1], -(Math.abs(axes[2] ?? 0) > DEAD_ZONE ? axes[2] : axes[0])]
    .map((part) => (Math.abs(part) > DEAD_ZONE ? part : 0)));
  const most = [sum, hand.pad, ...pads].sort((a, b) => Math.hypot(...b) - Math.hypot(...a))[0];
  return most.map((part) => Math.min(1, Math.max(-1, part)));
}
