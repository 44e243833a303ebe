// Controls, legend, and the loop that draws when something has changed.

// In the order of the shader.
const WAYS = ['height', 'intensity', 'class', 'return', 'object', 'leg', 'channel', 'time', 'rgb'];
const NAMES = { height: 'height', intensity: 'intensity', class: 'class', return: 'echo number', object: 'object', leg: 'leg', channel: 'channel', time: 'time, s', rgb: 'colour' };
const ways = WAYS.filter(way => meta[way]);
const hidden = Object.fromEntries(WAYS.map(way => [way, new Set()]));
const shown = { way: meta.colour, size: 1, cut: half[2] * 1.001 + 1, shading: true };

// ---- drawing on demand ----

let asked = false, busyUntil = 0, settle = 0, share = 1, lastFrame = 0;

/** Asks for a new picture; `moving` for one of many, which may be coarser. */
function redraw(moving = false) {
  if (moving) busyUntil = performance.now() + 180;
  if (asked) return;
  asked = true;
  requestAnimationFrame(frame);
}

function frame(now) {
  asked = false;
  const dots = devicePixelRatio || 1;
  const [width, height] = [Math.max(1, Math.round(canvas.clientWidth * dots)), Math.max(1, Math.round(canvas.clientHeight * dots))];
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const moving = now < busyUntil;
  const took = now - lastFrame;
  lastFrame = now;
  // Fewer points while the view moves on a machine that cannot draw all of them in time.
  if (moving && took < 400) share = Math.min(1, Math.max(0.02, share * (took > 45 ? 0.7 : took < 25 ? 1.15 : 1)));
  const way = meta[shown.way];
  const ground = getComputedStyle(page).getPropertyValue('--ground').trim();
  draw(viewOf(width, height), {
    by: WAYS.indexOf(shown.way), low: (way.low ?? 0) - half[2], high: (way.high ?? 1) - half[2],
    size: shown.size, least: Math.max(1, 1.2 * dots * Math.min(1, shown.size)), cut: shown.cut, shading: shown.shading,
    ground: [1, 3, 5].map(i => parseInt(ground.slice(i, i + 2), 16) / 255),
  }, moving ? share : 1);
  furniture();
  if (moving) {
    clearTimeout(settle);
    settle = setTimeout(() => redraw(), Math.max(0, busyUntil - performance.now()) + 10);
  }
}

function furniture() {
  const metres = metresPerPixel(), room = Math.min(220, canvas.clientWidth * 0.3) * metres;
  const decade = 10 ** Math.floor(Math.log10(room));
  const length = [5, 2, 1].map(n => n * decade).find(n => n <= room) ?? decade;
  $('scale-bar').style.width = length / metres + 'px';
  const text = length >= 1000 ? length / 1000 + ' km' : length >= 1 ? length + ' m' : length >= 0.01 ? Math.round(length * 100) + ' cm' : +(length * 1000).toPrecision(1) + ' mm';
  $('scale-text').textContent = camera.parallel ? text : text + ' in the middle';
  $('needle').setAttribute('transform', `rotate(${-camera.heading * 180 / Math.PI})`);
}

// ---- colours and legend ----

const hex = rgb => '#' + rgb.map(c => c.toString(16).padStart(2, '0')).join('');

function mixed(table, t) {
  const at = t * (table.length - 1), i = Math.min(Math.floor(at), table.length - 2);
  return table[i].map((c, k) => Math.round(c + (table[i + 1][k] - c) * (at - i)));
}

function recolour() {
  const way = meta[shown.way], table = new Uint8Array(4 * 65536).fill(255);
  const set = (i, rgb, alpha) => table.set([...rgb, alpha], 4 * i);
  const spread = (bits, count) => Math.round((bits & (1 << count) - 1) * 255 / ((1 << count) - 1));
  if (way.own) for (let i = 0; i < 65536; i++) set(i, [spread(i, 5), spread(i >> 5, 6), spread(i >> 11, 5)], 255);
  else if (way.ramp) for (let i = 0; i < 256; i++) set(i, mixed(way.ramp, i / 255), 255);
  else for (const [value, , rgb] of way.entries) set(value, rgb, hidden[shown.way].has(value) ? 0 : 255);
  colour(table);
  redraw();
}

function legend() {
  const way = meta[shown.way], box = $('legend');
  const title = document.createElement('h2');
  title.textContent = shown.way === 'height' ? 'height, m' : NAMES[shown.way];
  box.replaceChildren(title, way.own ? '' : way.ramp ? ramp(way) : list(way));
}

function ramp(way) {
  const box = document.createElement('div'), bar = document.createElement('i'), ticks = document.createElement('ol');
  box.className = 'ramp';
  bar.style.background = `linear-gradient(to top, ${way.ramp.map(hex)})`;
  const [low, high] = [way.low + (way.shift ?? 0), way.high + (way.shift ?? 0)];
  const decade = 10 ** Math.floor(Math.log10((high - low) / 3));
  const step = [5, 2, 1].map(n => n * decade).find(n => n <= (high - low) / 3) ?? decade;
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const mark = (share, text) => {
    const line = document.createElement('li');
    line.style.bottom = 100 * share + '%';
    line.textContent = text;
    ticks.append(line);
  };
  if (way.marks) way.marks.forEach(([share, text]) => mark(share, text));
  else for (let tick = Math.ceil(low / step) * step; tick <= high + step * 1e-6; tick += step) {
    mark((tick - low) / (high - low), (Math.abs(tick) < step * 1e-6 ? 0 : tick).toFixed(decimals));
  }
  box.append(bar, ticks);
  return box;
}

/** Entries with boxes that hide and show their points. */
function list(way) {
  const box = document.createElement('div'), all = way.entries.slice(0, 40);
  for (const [value, name, rgb, count] of all) {
    const line = document.createElement('label'), mark = document.createElement('i');
    const check = document.createElement('input'), share = document.createElement('small');
    line.className = 'entry';
    check.type = 'checkbox';
    check.checked = !hidden[shown.way].has(value);
    check.addEventListener('change', () => {
      hidden[shown.way][check.checked ? 'delete' : 'add'](value);
      recolour();
    });
    mark.style.background = hex(rgb);
    const percent = 100 * count / meta.shown;
    share.textContent = percent >= 9.95 ? percent.toFixed(0) + ' %' : percent >= 0.095 ? percent.toFixed(1) + ' %' : '< 0.1 %';
    line.append(check, mark, name, share);
    box.append(line);
  }
  if (way.entries.length > all.length) box.append(`and ${way.entries.length - all.length} more`);
  return box;
}

// ---- what the user sets ----

function colourBy(way) {
  if (!meta[way]) return;
  shown.way = $('colour').value = way;
  legend();
  recolour();
}

for (const way of ways) $('colour').append(new Option(NAMES[way], way));
$('colour').addEventListener('change', e => colourBy(e.target.value));
$('size').addEventListener('input', () => { shown.size = 2 ** Number($('size').value); redraw(); });
$('shade').addEventListener('change', () => { shown.shading = $('shade').checked; redraw(); });
$('perspective').addEventListener('change', () => { camera.parallel = !$('perspective').checked; redraw(); });
$('cut').addEventListener('input', () => {
  const part = Number($('cut').value) / 1000;
  shown.cut = part === 1 ? half[2] * 1.001 + 1 : part * meta.size[2] - half[2];
  $('cut-value').textContent = part === 1 ? '' : (meta.low[2] + part * meta.size[2]).toFixed(1) + ' m';
  redraw();
});
$('whole').addEventListener('click', () => { look(0.6, 0.6); redraw(); });
$('above').addEventListener('click', () => { look(0, Math.PI / 2); redraw(); });
$('south').addEventListener('click', () => { look(0, 0); redraw(); });
$('theme').addEventListener('click', () => { page.dataset.theme = page.dataset.theme === 'light' ? 'dark' : 'light'; redraw(); });
$('save').addEventListener('click', () => {
  frame(performance.now());
  canvas.toBlob(blob => {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(blob);
    link.download = (meta.name || 'points') + '.png';
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  });
});

// ---- pointers ----

const fingers = new Map();
canvas.addEventListener('contextmenu', e => e.preventDefault());
canvas.addEventListener('pointerdown', e => {
  canvas.setPointerCapture(e.pointerId);
  fingers.set(e.pointerId, e);
});
for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, e => fingers.delete(e.pointerId));
canvas.addEventListener('pointermove', e => {
  const before = fingers.get(e.pointerId);
  if (!before) return;
  const [dx, dy] = [e.clientX - before.clientX, e.clientY - before.clientY];
  const other = [...fingers.values()].find(finger => finger.pointerId !== e.pointerId);
  if (other) {
    const apart = finger => Math.hypot(finger.clientX - other.clientX, finger.clientY - other.clientY);
    zoom(Math.max(apart(before), 1) / Math.max(apart(e), 1));
    move(dx / 2, dy / 2);
  } else if (e.buttons & 6 || e.shiftKey || e.ctrlKey) move(dx, dy);
  else turn(dx * 0.006, dy * 0.006);
  fingers.set(e.pointerId, e);
  redraw(true);
});
canvas.addEventListener('wheel', e => {
  e.preventDefault();
  const lines = e.deltaMode === 1 ? 30 : e.deltaMode === 2 ? 300 : 1;
  zoom(Math.exp(Math.max(-0.5, Math.min(0.5, e.deltaY * lines * 0.0015))), e.clientX - canvas.clientWidth / 2, e.clientY - canvas.clientHeight / 2);
  redraw(true);
}, { passive: false });
canvas.addEventListener('dblclick', e => turnAbout(e.clientX, e.clientY));

function isShown(block, i) {
  if (block.position[3 * i + 2] > shown.cut) return false;
  const { way } = shown;
  return way === 'object' ? !hidden.object.has(block.object[i])
    : way === 'class' || way === 'return' ? !hidden[way].has(block.values[4 * i + (way === 'class' ? 1 : 2)]) : true;
}

function turnAbout(x, y) {
  const found = pick(x, y, isShown);
  if (!found) return;
  const { block, at } = found;
  const place = [0, 1, 2].map(axis => block.position[3 * at + axis]);
  const { forward } = axes();
  const offset = along(place.map((p, i) => p - camera.target[i]), forward);
  camera.distance = Math.max(camera.distance + (camera.parallel ? 0 : offset), radius * 1e-5);
  camera.target = place;
  const entry = (way, value) => meta[way]?.entries.find(([v]) => v === value)?.[1];
  $('status').textContent = [
    place.map((p, i) => 'xyz'[i] + ' ' + (p + half[i] + meta.low[i]).toFixed(2)).join('  '),
    entry('class', block.values[4 * at + 1]), entry('return', block.values[4 * at + 2]),
    meta.object && 'object ' + entry('object', block.object[at]),
  ].filter(Boolean).join(' · ');
  redraw();
}

// ---- keys ----

const KEYS = {
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1],
};
addEventListener('keydown', e => {
  if (e.ctrlKey || e.altKey || e.metaKey) return;
  const inControl = e.target.closest?.('input, select, button, summary');
  const way = KEYS[e.key];
  if (way) {
    if (inControl) return;
    e.preventDefault();
    e.shiftKey ? move(-30 * way[0], -30 * way[1]) : turn(-0.08 * way[0], -0.08 * way[1]);
    return redraw(true);
  }
  if (inControl && (e.key === 'Enter' || inControl.tagName === 'SELECT')) return;
  const click = id => $(id).click();
  const step = by => { $('size').value = Number($('size').value) + by; $('size').dispatchEvent(new Event('input')); };
  switch (e.key) {
    case '+': case '=': zoom(0.85); return redraw(true);
    case '-': case '_': zoom(1 / 0.85); return redraw(true);
    case '[': return step(-0.3);
    case ']': return step(0.3);
    case 'Enter': return turnAbout(canvas.clientWidth / 2, canvas.clientHeight / 2);
    case 'r': case 'R': return click('whole');
    case 't': case 'T': return click('above');
    case 's': case 'S': return click('south');
    case 'o': case 'O': return click('perspective');
    case 'e': case 'E': return click('shade');
    case 'l': case 'L': return click('theme');
    default: if (ways[Number(e.key) - 1]) colourBy(ways[Number(e.key) - 1]);
  }
});

// ---- start ----

if (matchMedia('(prefers-color-scheme: light)').matches) page.dataset.theme = 'light';
if (matchMedia('(max-width: 640px)').matches) $('settings').open = false;
if (!gl) fail('This browser does not draw with WebGL 2, which this page needs.');
else {
  canvas.addEventListener('webglcontextlost', e => e.preventDefault());
  canvas.addEventListener('webglcontextrestored', () => { prepare(); recolour(); });
  addEventListener('resize', () => redraw());
  prepare();
  if (meta.cut !== null) {
    $('cut').value = Math.round(1000 * (meta.cut - meta.low[2]) / meta.size[2]);
    $('cut').dispatchEvent(new Event('input'));
  }
  look(0.6, 0.6);
  colourBy(shown.way);
  load(upload).then(() => {
    frame(performance.now());
    const error = gl.getError();
    if (error) return fail('WebGL error ' + error);
    if (page.dataset.state !== 'error') page.dataset.state = 'ready';
    page.dataset.points = blocks.reduce((sum, block) => sum + block.count, 0);
  });
}
