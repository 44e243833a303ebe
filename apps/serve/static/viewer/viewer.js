// Shows a COPC: chooses the nodes that the picture needs, has them read and decoded, and draws them.

import { Camera } from './camera.js';
import { Copc } from './copc.js';
import { follow } from './hands.js';
import { COLOURINGS, Painter, RAMPS, RETURNS, classOf } from './painter.js';

const MAX_REQUESTS = 6;
// A node is divided where its points are farther apart than this, pixels.
const MIN_GAP = 1.5;
// Nodes that are kept beyond those in the picture, as a multiple of the budget.
const KEPT = 2;
const MAX_WORKERS = 4;
// Marks of a colour bar, and the longest scale bar as a share of the picture's width.
const TICKS = 5;
const RULER = 0.25;
// Share of the picture that points should cover, and the most that they are enlarged for it.
const MIN_COVERAGE = 0.25;
const MAX_GAP = 3;

class Viewer {
  constructor(place) {
    this.place = place;
    this.canvas = place.querySelector('canvas');
    this.painter = new Painter(this.canvas);
    this.camera = new Camera();
    this.copc = new Copc(place.dataset.cloud);
    // Nodes by key, those used last at the end.
    this.loaded = new Map();
    this.requests = new Map();
    this.workers = [];
    this.classes = new Set();
    this.isDue = false;
    this.isBegun = false;
    this.options = { colouring: 'height', size: 2, budget: 1e6, heights: [0, 1], slab: null };
  }

  async start() {
    const count = Math.min(MAX_WORKERS, Math.max(1, (navigator.hardwareConcurrency || 2) - 1));
    const decoder = fetch('/static/laz-perf.wasm').then((answer) => answer.arrayBuffer());
    this.started = decoder.then((wasm) => Promise.all(Array.from({ length: count }, () => this.worker(wasm))));
    this.started.catch(() => {});
    await this.copc.open();
    const { copc } = this;
    if (!copc.root) throw new Error('the cloud has no points');
    const { format, record, scale, offset, centre, object, amplitude } = copc;
    this.head = { format, record, scale, offset, centre, object, amplitude };
    this.low = copc.min.map((value, axis) => value - centre[axis]);
    this.high = copc.max.map((value, axis) => value - centre[axis]);
    this.options.heights = [this.low[2], Math.max(this.high[2], this.low[2] + 0.01)];
    this.resize();
    this.home();
    if (copc.root.count > 0) await this.load(copc.root);
    this.isBegun = true;
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    follow(this);
    this.controls();
  }

  worker(wasm) {
    return new Promise((resolve, reject) => {
      const worker = new Worker('/static/viewer/decoder.js');
      worker.jobs = 0;
      worker.onmessage = ({ data }) => {
        if (!data.ready) {
          reject(new Error(data.failure));
          return;
        }
        worker.onmessage = (event) => this.decoded(worker, event.data);
        resolve(worker);
      };
      worker.onerror = () => reject(new Error('the decoder cannot be loaded'));
      worker.postMessage({ wasm });
    });
  }

  // Reads a node and has it decoded.
  async load(node) {
    node.state = 'loading';
    const stop = new AbortController();
    const done = new Promise((resolve) => {
      this.requests.set(node.key, { node, stop, resolve });
    });
    try {
      const bytes = await this.copc.range(node.start, node.length, stop.signal);
      this.workers = await this.started;
      const worker = this.workers.reduce((least, one) => (one.jobs < least.jobs ? one : least));
      worker.jobs += 1;
      worker.postMessage({ head: this.head, key: node.key, bytes, count: node.count }, [bytes]);
    } catch (error) {
      this.requests.delete(node.key);
      node.state = stop.signal.aborted ? 'none' : 'failed';
      if (!stop.signal.aborted) this.fail(error);
      return undefined;
    }
    return done;
  }

  decoded(worker, { key, positions, values, quantiles, isPart, failure }) {
    const { node, resolve } = this.requests.get(key);
    if (isPart) {
      this.measure(positions);
      this.show(node, positions, values);
      return;
    }
    worker.jobs -= 1;
    this.requests.delete(key);
    if (failure) {
      node.state = 'failed';
      this.fail(new Error(failure));
    } else {
      if (quantiles) {
        this.workers.filter((other) => other !== worker).forEach((other) => other.postMessage({ quantiles }));
        this.measure(positions);
      }
      for (let i = 0; i < values.length; i += 4) this.classes.add(values[i]);
      node.state = 'ready';
      this.show(node, positions, values);
    }
    resolve();
    this.redraw();
  }

  // Has points drawn as those of a node, in place of the first ones of it.
  show(node, positions, values) {
    const known = this.loaded.get(node.key);
    if (known) this.painter.free(known);
    this.loaded.set(node.key, { node, ...this.painter.upload({ positions, values }) });
    this.isBegun = true;
    this.redraw();
  }

  // Colours span the heights of the root without the lowest and highest thousandth.
  measure(positions) {
    const heights = positions.filter((_, i) => i % 3 === 2).sort();
    const at = (share) => heights[Math.floor(share * (heights.length - 1))];
    this.options.heights = [at(0.001), Math.max(at(0.999), at(0.001) + 0.01)];
    this.legend();
  }

  // Nodes that the picture needs, the largest in it first, until the budget is used up.
  needed() {
    const { camera, copc, options } = this;
    const eye = camera.eye();
    const pixels = camera.pixels();
    const found = [];
    const open = [];
    let points = 0;
    const add = (node) => {
      const radius = (node.edge * Math.sqrt(3)) / 2;
      const { slab } = options;
      if (slab && Math.abs(node.centre[slab.axis] - slab.at) > slab.half + node.edge / 2) return;
      if (!camera.sees(node.centre, radius)) return;
      const distance = Math.hypot(...node.centre.map((value, axis) => value - eye[axis]));
      const gap = ((copc.spacing / 2 ** node.level) * pixels) / Math.max(distance - radius, camera.planes().near);
      open.push({ node, gap });
    };
    add(copc.root);
    while (open.length > 0 && points < options.budget) {
      let best = 0;
      for (let i = 1; i < open.length; i += 1) if (open[i].gap > open[best].gap) best = i;
      const { node, gap } = open[best];
      open[best] = open[open.length - 1];
      open.pop();
      if (node.count < 0) {
        if (node.state === 'none') copc.expand(node).then(() => this.redraw(), (error) => this.fail(error));
      } else {
        if (node.count > 0) found.push(node);
        points += node.count;
        if (gap > MIN_GAP) copc.children(node).forEach(add);
      }
    }
    return found;
  }

  draw() {
    this.isDue = false;
    const needed = this.needed();
    const wanted = new Set(needed.map((node) => node.key));
    for (const [key, { node, stop }] of this.requests) {
      if (!wanted.has(key) && node !== this.copc.root) stop.abort();
    }
    // The root comes alone, so that something is seen soon, and tells the strengths that intensities are ranked by.
    const mayLoad = !this.requests.has(this.copc.root.key);
    const shown = [];
    let points = 0;
    for (const node of needed) {
      const ready = this.loaded.get(node.key);
      if (ready) {
        this.loaded.delete(node.key);
        this.loaded.set(node.key, ready);
        shown.push(ready);
        points += ready.count;
      } else if (node.state === 'none' && mayLoad && this.requests.size < MAX_REQUESTS) this.load(node);
    }
    this.forget(wanted);
    this.painter.draw(shown, this.camera, { ...this.options, size: this.size(points) });
    const isComplete = needed.every((node) => node.state === 'ready' || node.state === 'failed');
    this.ruler();
    this.tell(points, shown.length, isComplete);
  }

  // The scale bar: a round length at the point around which the camera turns.
  ruler() {
    const { place, canvas, camera } = this;
    const most = camera.metres() * (window.devicePixelRatio || 1) * canvas.clientWidth * RULER;
    if (!(most > 0)) return;
    const unit = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].find((factor) => factor * unit <= most) * unit;
    const bar = place.querySelector('.ruler');
    bar.hidden = false;
    bar.style.width = `${(100 * RULER * length) / most}%`;
    const text = length >= 1000 ? `${length / 1000} km` : length >= 1 ? `${length} m` : `${Number((length * 100).toPrecision(1))} cm`;
    bar.firstElementChild.textContent = text;
  }

  // Size of points, pixels: few points are drawn larger.
  size(points) {
    const { width, height } = this.canvas;
    const gap = Math.sqrt((MIN_COVERAGE * width * height) / Math.max(points, 1));
    return this.options.size * Math.min(Math.max(gap, window.devicePixelRatio || 1), MAX_GAP);
  }

  // Frees nodes that were not drawn for longest.
  forget(wanted) {
    let kept = 0;
    for (const { count } of this.loaded.values()) kept += count;
    for (const [key, ready] of this.loaded) {
      if (kept <= KEPT * this.options.budget) return;
      if (wanted.has(key)) continue;
      this.painter.free(ready);
      this.loaded.delete(key);
      ready.node.state = 'none';
      kept -= ready.count;
    }
  }

  tell(points, nodes, isComplete) {
    const { place, copc } = this;
    const facts = { points, nodes, bytes: copc.bytes };
    if (place.dataset.state !== 'failed') facts.state = isComplete ? 'complete' : 'loading';
    if (points > 0 && !place.dataset.first) facts.first = Math.round(performance.now());
    Object.assign(place.dataset, facts);
    const number = (value) => value.toLocaleString('en');
    place.querySelector('.count').textContent = `${number(points)} of ${number(copc.points)} points`;
    if (isComplete && this.known !== this.classes.size) {
      this.known = this.classes.size;
      this.legend();
    }
  }

  fail(error) {
    this.place.dataset.state = 'failed';
    this.place.querySelector('.said').textContent = error.message;
  }

  redraw() {
    if (this.isDue || !this.isBegun) return;
    this.isDue = true;
    requestAnimationFrame(() => this.draw());
  }

  resize() {
    const { canvas, camera } = this;
    const scale = window.devicePixelRatio || 1;
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * scale));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * scale));
    [camera.width, camera.height] = [canvas.width, canvas.height];
    this.redraw();
  }

  home(heading, pitch) {
    this.camera.show(this.low, this.high, heading, pitch);
    this.redraw();
  }

  controls() {
    const { place, options } = this;
    const field = (name) => place.querySelector(`[name=${name}]`);
    place.querySelector('.controls').hidden = false;
    const change = () => {
      options.colouring = COLOURINGS.find((name) => name === field('colouring').value) || 'height';
      options.size = Number(field('size').value);
      options.budget = Number(field('budget').value);
      const axis = ['x', 'y', 'z'].indexOf(field('section').value);
      for (const name of ['at', 'thickness']) field(name).disabled = axis < 0;
      for (const label of place.querySelectorAll('.of-section')) label.hidden = axis < 0;
      if (axis < 0) options.slab = null;
      else {
        const length = this.high[axis] - this.low[axis];
        const half = Math.max(0.005, (length * Number(field('thickness').value) ** 2) / 2);
        options.slab = { axis, at: this.low[axis] + length * Number(field('at').value), half };
      }
      const told = options.slab
        ? `· Section: ${'xyz'[axis]} = ${(options.slab.at + this.copc.centre[axis]).toFixed(2)} ± ${options.slab.half.toFixed(2)} m` : '';
      place.querySelector('.slab').textContent = told;
      this.legend();
      this.redraw();
    };
    place.querySelector('[data-full]').hidden = !place.requestFullscreen;
    place.querySelector('.controls').addEventListener('input', change);
    place.querySelector('.controls').addEventListener('click', ({ target }) => {
      const views = { home: [], above: [0, 2], south: [0, 0], east: [Math.PI / 2, 0] };
      if (target.dataset.view) this.home(...views[target.dataset.view]);
      if (target.dataset.full !== undefined) place.requestFullscreen();
    });
    change();
  }

  // The colour bar with its marks; hidden where colours are not along a scale.
  bar(colours, ticks) {
    const bar = this.place.querySelector('.bar');
    bar.hidden = ticks.length === 0;
    if (bar.hidden) return;
    bar.setAttribute('aria-label', `Colours from ${ticks[0]} to ${ticks[ticks.length - 1]}`);
    bar.querySelector('.ramp').style.background = `linear-gradient(to right, ${colours.join(', ')})`;
    bar.querySelector('.ticks').replaceChildren(...ticks.map((text) => {
      const tick = document.createElement('span');
      tick.textContent = text;
      return tick;
    }));
  }

  legend() {
    const { place, options, copc } = this;
    const [lowest, highest] = options.heights;
    // So many decimals that a hundredth of the span is seen.
    const digits = Math.min(Math.max(2 - Math.floor(Math.log10(highest - lowest)), 1), 4);
    const rounded = (value) => (value + copc.centre[2]).toFixed(digits).replace(/^-(0\.0+)$/, '$1');
    const shares = Array.from({ length: TICKS }, (_, at) => at / (TICKS - 1));
    const bars = {
      height: () => shares.map((share) => `${rounded(lowest + share * (highest - lowest))} m`),
      intensity: () => ['weak', 'strong'],
    };
    this.bar(options.colouring === 'height' ? RAMPS[0] : RAMPS[1], bars[options.colouring]?.() || []);
    const entries = {
      height: () => [],
      intensity: () => [],
      return: () => RETURNS,
      class: () => [...this.classes].sort((a, b) => a - b).map(classOf),
      object: () => [[copc.object ? 'each object has a colour' : 'the points have no objects', '#e6194b']],
    }[options.colouring]();
    const list = place.querySelector('.legend');
    list.replaceChildren(...entries.map(([name, colour]) => {
      const [item, mark] = [document.createElement('li'), document.createElement('span')];
      mark.className = 'mark';
      mark.style.background = colour;
      item.append(mark, name);
      return item;
    }));
  }
}

const place = document.getElementById('cloud');
if (place) {
  const fail = (error) => {
    place.dataset.state = 'failed';
    place.querySelector('.said').textContent = `The points cannot be shown here: ${error.message}.`;
    place.querySelector('canvas').hidden = true;
    place.querySelector('.instead').hidden = false;
  };
  try {
    new Viewer(place).start().catch(fail);
  } catch (error) {
    fail(error);
  }
}
