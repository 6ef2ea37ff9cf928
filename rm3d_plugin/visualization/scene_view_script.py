"""The script of the 3D view: draws points on a plain canvas with a depth buffer of its own; needs no library."""

SCRIPT = r"""(function () {
'use strict';
const byId = (name) => document.getElementById('view-' + name);
const data = JSON.parse(byId('data').textContent);
const canvas = byId('canvas'), paper = canvas.getContext('2d', {alpha: false});
const GROUND = pack(20, 24, 29), NONE = pack(96, 100, 106), RIGHT = pack(74, 78, 84), WRONG = pack(255, 64, 48);
const START = {yaw: 0.6, pitch: 0.9, zoom: 1};
const ERRORS = -1;
let scene = null, layer = 0, colors = null, hidden = new Set();
let camera = null, image = null, pixels = null, depth = null, owner = null, waiting = false;

function pack(r, g, b) { return (255 << 24 | b << 16 | g << 8 | r) >>> 0; }

/* ---------------------------------------------------------------- data */

function bytes(text) {
  const raw = atob(text), out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out.buffer;
}

function numbers(text, width) {
  const view = new DataView(bytes(text)), count = view.byteLength / width;
  const out = width === 1 ? new Uint8Array(count) : width === 2 ? new Uint16Array(count) : new Uint32Array(count);
  for (let i = 0; i < count; i++) {
    out[i] = width === 1 ? view.getUint8(i) : width === 2 ? view.getUint16(2 * i, true) : view.getUint32(4 * i, true);
  }
  return out;
}

function open(packed) {
  const q = numbers(packed.xyz, 2), xyz = new Float32Array(q.length), high = [0, 0, 0];
  for (let i = 0; i < q.length; i++) {
    xyz[i] = packed.step[i % 3] * q[i];
    high[i % 3] = Math.max(high[i % 3], xyz[i]);
  }
  const layers = packed.layers.map((item) => ({
    name: item.name, kind: item.kind, role: item.role, values: numbers(item.data, item.kind === 'number' ? 2 : 1)
  }));
  const role = (name) => layers.find((item) => item.role === name);
  return {
    packed: packed, xyz: xyz, high: high, layers: layers, marked: numbers(packed.marked, 4),
    truth: role('truth'), prediction: role('prediction'), count: packed.count
  };
}

/* ---------------------------------------------------------------- colours */

const classColors = data.classes.map((item) => {
  const value = parseInt(item.color.slice(1), 16);
  return pack(value >> 16, value >> 8 & 255, value & 255);
});

function numberColor(id) {
  const hue = (id * 0.6180339887498949) % 1, value = 0.55 + 0.4 * ((id * 7) % 5) / 4;
  const part = (shift) => {
    const ramp = Math.min(1, Math.max(0, Math.abs((hue * 6 + shift) % 6 - 3) - 1));
    return Math.round(255 * value * (1 - 0.75 * (1 - ramp)));
  };
  return pack(part(0), part(4), part(2));
}

function colorOf(item, i) {
  if (item.kind === 'rgb') return pack(item.values[3 * i], item.values[3 * i + 1], item.values[3 * i + 2]);
  const value = item.values[i];
  if (item.kind === 'number') return value === 65535 ? NONE : numberColor(value);
  return value < classColors.length ? classColors[value] : NONE;
}

function paint() {
  const errors = layer === ERRORS, item = errors ? scene.prediction : scene.layers[layer];
  const fade = byId('fade').checked && item.kind === 'class' && scene.truth && item !== scene.truth;
  colors = new Uint32Array(scene.count);
  for (let i = 0; i < scene.count; i++) {
    const known = scene.truth && scene.truth.values[i] !== 255;
    const same = known && item.values[i] === scene.truth.values[i];
    if (item.kind === 'class' && hidden.has(item.values[i])) colors[i] = 0;
    else if (errors) colors[i] = known ? (same ? RIGHT : WRONG) : NONE;
    else colors[i] = fade && (same || !known) ? RIGHT : colorOf(item, i);
  }
}

/* ---------------------------------------------------------------- drawing */

function resize() {
  const ratio = Math.min(window.devicePixelRatio || 1, 1.5);
  canvas.width = Math.max(2, Math.round(canvas.clientWidth * ratio));
  canvas.height = Math.max(2, Math.round(canvas.clientHeight * ratio));
  image = paper.createImageData(canvas.width, canvas.height);
  pixels = new Uint32Array(image.data.buffer);
  depth = new Float32Array(pixels.length);
  owner = new Int32Array(pixels.length);
  ask();
}

function reset() {
  const [x, y, z] = scene.high, reach = Math.hypot(x, y, z) || 1;
  camera = {yaw: START.yaw, pitch: START.pitch, target: [x / 2, y / 2, z / 3], distance: 1.3 * reach, reach: reach};
  ask();
}

function basis() {
  const ca = Math.cos(camera.yaw), sa = Math.sin(camera.yaw), ce = Math.cos(camera.pitch), se = Math.sin(camera.pitch);
  return {right: [ca, sa, 0], ahead: [-sa * ce, ca * ce, -se], up: [-sa * se, ca * se, ce]};
}

function focal() { return 1.1 * Math.min(canvas.width, 1.6 * canvas.height); }

function square(px, py, half, far, color, id) {
  const w = canvas.width, h = canvas.height;
  const x0 = Math.max(0, Math.round(px - half)), x1 = Math.min(w - 1, Math.round(px + half));
  const y0 = Math.max(0, Math.round(py - half)), y1 = Math.min(h - 1, Math.round(py + half));
  for (let y = y0; y <= y1; y++) {
    for (let at = y * w + x0, end = y * w + x1; at <= end; at++) {
      if (far < depth[at]) { depth[at] = far; pixels[at] = color; owner[at] = id; }
    }
  }
}

function draw() {
  waiting = false;
  const {right, ahead, up} = basis(), f = focal(), w = canvas.width, h = canvas.height, xyz = scene.xyz;
  const top = scene.high[2] * byId('cut').value / 100 + 1e-4, size = byId('size').value / 3;
  const spacing = camera.reach / Math.sqrt(scene.count + 1), ring = Math.max(2, w / 350);
  const marked = byId('marks').checked && layer !== ERRORS && scene.layers[layer].role === 'labels';
  pixels.fill(GROUND); depth.fill(Infinity); owner.fill(-1);
  const place = (i) => {
    const [x, y, z] = camera.target.map((middle, axis) => xyz[3 * i + axis] - middle);
    const far = x * ahead[0] + y * ahead[1] + z * ahead[2] + camera.distance;
    if (far < 0.02 * camera.reach) return null;
    const k = f / far;
    return [w / 2 + k * (x * right[0] + y * right[1]), h / 2 - k * (x * up[0] + y * up[1] + z * up[2]), far];
  };
  for (let i = 0; i < scene.count; i++) {
    if (colors[i] === 0 || xyz[3 * i + 2] > top) continue;
    const at = place(i);
    if (!at) continue;
    const edge = Math.min(24, size * spacing * f / at[2]);
    square(at[0], at[1], Math.max(0, edge - 0.5) / 2, at[2], colors[i], i);
  }
  shade(w, h);
  if (marked) for (const i of scene.marked) {
    const at = colors[i] === 0 || xyz[3 * i + 2] > top ? null : place(i);
    if (!at) continue;
    square(at[0], at[1], ring + 1.5, at[2] * 0.985, pack(255, 255, 255), i);
    square(at[0], at[1], ring, at[2] * 0.984, colors[i], i);
  }
  paper.putImageData(image, 0, 0);
}

function shade(w, h) {
  /* Darker where neighbouring pixels lie nearer: edges and depth become visible. */
  for (let y = 1; y < h - 1; y++) {
    for (let at = y * w + 1, end = y * w + w - 1; at < end; at++) {
      const own = depth[at];
      if (own === Infinity) continue;
      let gap = 0;
      for (const other of [depth[at - 1], depth[at + 1], depth[at - w], depth[at + w]]) {
        if (other < own) gap += own - other;
      }
      if (gap < 0.002 * own) continue;
      const k = Math.max(0.35, 1 - 6 * gap / own), c = pixels[at];
      pixels[at] = pack((c & 255) * k, (c >> 8 & 255) * k, (c >> 16 & 255) * k);
    }
  }
}

function ask() {
  if (!waiting && scene && camera) { waiting = true; requestAnimationFrame(draw); }
}

/* ---------------------------------------------------------------- controls */

function choose(number) {
  layer = number;
  for (const button of byId('layers').children) {
    button.setAttribute('aria-pressed', String(Number(button.value) === layer));
  }
  paint(); legend(); ask();
}

function legend() {
  const list = byId('legend'), item = layer === ERRORS ? null : scene.layers[layer];
  list.textContent = '';
  const add = (color, text, click, off) => {
    const row = document.createElement('li'), swatch = document.createElement('span');
    swatch.className = 'swatch'; swatch.style.background = color;
    const part = click ? document.createElement('button') : row;
    if (click) { part.type = 'button'; part.addEventListener('click', click); row.append(part); }
    if (off) part.className = 'off';
    part.append(swatch, text); list.append(row);
  };
  if (!item) {
    add('#ff4030', 'wrong'); add('#4a4e54', 'correct'); add('#60646a', 'truth not known');
  } else if (item.kind === 'class') {
    const counts = new Map();
    for (const value of item.values) counts.set(value, (counts.get(value) || 0) + 1);
    for (const value of [...counts.keys()].sort((a, b) => a - b)) {
      const named = data.classes[value], share = 100 * counts.get(value) / scene.count;
      const text = (named ? named.name : 'none') + ' ' + share.toFixed(share < 10 ? 1 : 0) + ' %';
      add(named ? named.color : '#60646a', text, () => {
        if (!hidden.delete(value)) hidden.add(value);
        paint(); legend(); ask();
      }, hidden.has(value));
    }
  } else if (item.kind === 'number') {
    add('#60646a', 'none');
  }
}

function buttons() {
  const box = byId('layers');
  box.textContent = '';
  const add = (text, number) => {
    const button = document.createElement('button');
    button.type = 'button'; button.textContent = text; button.value = String(number);
    button.addEventListener('click', () => choose(number));
    box.append(button);
  };
  scene.layers.forEach((item, number) => add(item.name, number));
  if (scene.truth && scene.prediction) add('errors', ERRORS);
}

function show(number) {
  const kept = scene && layer !== ERRORS ? scene.layers[layer].name : layer === ERRORS ? 'errors' : '';
  scene = open(data.scenes[number]);
  buttons();
  const found = scene.layers.findIndex((item) => item.name === kept);
  reset();
  choose(kept === 'errors' && scene.truth && scene.prediction ? ERRORS : Math.max(found, 0));
}

function describe(i) {
  if (i < 0) return '\u00a0';
  const parts = scene.layers.filter((item) => item.kind !== 'rgb').map((item) => {
    const value = item.values[i];
    if (item.kind === 'class') return item.name + ': ' + (data.classes[value] ? data.classes[value].name : 'none');
    return item.name + ': ' + (value === 65535 ? 'none' : value);
  });
  const where = [0, 1, 2].map((axis) => (scene.packed.low[axis] + scene.xyz[3 * i + axis]).toFixed(2));
  return '(' + where.join(', ') + ') m \u2013 ' + parts.join('; ');
}

function turn(dx, dy) {
  camera.yaw -= dx * 0.007;
  camera.pitch = Math.min(1.57, Math.max(-1.57, camera.pitch + dy * 0.007));
  ask();
}

function move(dx, dy) {
  const {right, up} = basis(), k = camera.distance / focal() * canvas.width / canvas.clientWidth;
  for (let axis = 0; axis < 3; axis++) camera.target[axis] += k * (dy * up[axis] - dx * right[axis]);
  ask();
}

function zoom(factor) {
  camera.distance = Math.min(5 * camera.reach, Math.max(0.05 * camera.reach, camera.distance * factor));
  ask();
}

const touching = new Map();
canvas.addEventListener('pointerdown', (event) => {
  canvas.focus(); canvas.setPointerCapture(event.pointerId);
  touching.set(event.pointerId, event);
});
for (const name of ['pointerup', 'pointercancel']) {
  canvas.addEventListener(name, (event) => touching.delete(event.pointerId));
}
canvas.addEventListener('pointermove', (event) => {
  const before = touching.get(event.pointerId);
  if (!before) {
    const box = canvas.getBoundingClientRect(), k = canvas.width / box.width;
    const x = Math.floor((event.clientX - box.left) * k), y = Math.floor((event.clientY - box.top) * k);
    if (owner && x >= 0 && x < canvas.width && y >= 0 && y < canvas.height) {
      byId('told').textContent = describe(owner[y * canvas.width + x]);
    }
    return;
  }
  const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
  touching.set(event.pointerId, event);
  if (touching.size === 2) {
    const other = [...touching.values()].find((e) => e.pointerId !== event.pointerId);
    const span = (e) => Math.hypot(e.clientX - other.clientX, e.clientY - other.clientY) || 1;
    zoom(span(before) / span(event)); move(dx / 2, dy / 2);
  } else if (event.shiftKey || event.buttons & 6) move(dx, dy);
  else turn(dx, dy);
});
canvas.addEventListener('contextmenu', (event) => event.preventDefault());
canvas.addEventListener('wheel', (event) => {
  if (document.activeElement !== canvas) return;
  event.preventDefault();
  zoom(Math.exp(event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
}, {passive: false});
canvas.addEventListener('keydown', (event) => {
  const acts = {
    ArrowLeft: () => turn(20, 0), ArrowRight: () => turn(-20, 0), ArrowUp: () => turn(0, 20),
    ArrowDown: () => turn(0, -20), '+': () => zoom(0.9), '=': () => zoom(0.9), '-': () => zoom(1.1), '0': reset
  };
  if (acts[event.key]) { event.preventDefault(); acts[event.key](); }
});
byId('scene').addEventListener('change', (event) => show(Number(event.target.value)));
byId('fade').addEventListener('change', () => { paint(); ask(); });
for (const name of ['marks', 'cut', 'size']) byId(name).addEventListener('input', ask);
byId('reset').addEventListener('click', reset);
byId('cut').value = String(Math.round(100 * data.cut));
window.addEventListener('resize', resize);
if (data.scenes.length) { show(0); resize(); }
}());
"""
