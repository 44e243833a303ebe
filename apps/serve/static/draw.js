'use strict';
// Forms of new scans: shows the pattern of the instrument, and draws an area, a line or places on the scene seen from above, with mouse,
// touch or keys; the shape goes into a field of the form as text.
(() => {
  const SVG = 'http://www.w3.org/2000/svg';
  const KINDS = {
    polygon: {
      least: 3, name: 'area', text: (all) => `POLYGON ((${[...all, all[0]].map((p) => p.join(' ')).join(', ')}))`,
    },
    line: { least: 2, name: 'line', text: (all) => `LINESTRING (${all.map((p) => p.join(' ')).join(', ')})` },
    points: { least: 1, name: 'places', text: (all) => all.map((p) => p.join(',')).join('\n') },
  };

  function element(name, attributes, parent) {
    const made = parent instanceof SVGElement || name === 'svg' ? document.createElementNS(SVG, name) : document.createElement(name);
    Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
    parent.append(made);
    return made;
  }

  class Drawing {
    constructor(place) {
      this.place = place;
      this.kind = KINDS[place.dataset.shape];
      this.form = place.closest('form');
      this.field = this.form.elements[place.dataset.field];
      this.corners = [];
      this.cursor = null;
      this.hint = element('p', { class: 'hint' }, place);
      this.sheet = element('div', {
        class: 'sheet', tabindex: '0', role: 'application', 'aria-label': `The scene from above, to draw the ${this.kind.name} on`,
      }, place);
      this.paper = element('div', { class: 'paper' }, this.sheet);
      this.picture = element('img', { alt: '', draggable: 'false' }, this.paper);
      this.svg = element('svg', { 'aria-hidden': 'true', preserveAspectRatio: 'none' }, this.paper);
      this.enlarged = 1;
      this.status = element('p', { role: 'status', class: 'facts' }, place);
      const tools = element('div', { class: 'views' }, place);
      const button = (label, act) => {
        const made = element('button', { type: 'button', class: 'quiet' }, tools);
        made.textContent = label;
        made.addEventListener('click', act);
      };
      const one = this.kind === KINDS.points ? 'place' : 'corner';
      button(`Remove the last ${one}`, () => this.change(this.corners.slice(0, -1)));
      button('Remove all', () => this.change([]));
      button('Enlarge the map', () => this.zoom(2));
      button('Reduce the map', () => this.zoom(0.5));
      this.hint.textContent = `Click on the scene to set ${one}s; or move the cross with the arrow keys (Shift: farther) and set a ${one} with `
        + 'Enter, remove the last one with Backspace, enlarge with + and reduce with −.';
      window.addEventListener('resize', () => this.zoom(0));
      this.picture.addEventListener('load', () => this.zoom(0));
      this.sheet.addEventListener('click', (event) => this.click(event));
      this.sheet.addEventListener('keydown', (event) => this.key(event));
      // When it is loaded, and when it is shown again: a map that is not shown has no width to draw for.
      new ResizeObserver(() => this.draw()).observe(this.picture);
      this.field.addEventListener('input', () => this.read());
      this.form.elements.scene.addEventListener('change', () => this.load());
      this.load();
    }

    async load() {
      const scene = this.form.elements.scene.value;
      this.place.hidden = !scene;
      this.frame = null;
      this.sheet.hidden = true;
      if (!scene) return;
      this.say('The scene is drawn …');
      const query = new URLSearchParams({ scene });
      try {
        const answer = await fetch(`/map.json?${query}`);
        const frame = await answer.json();
        if (this.form.elements.scene.value !== scene) return;
        if (!answer.ok) throw new Error(frame.detail);
        this.frame = frame;
        this.sheet.hidden = false;
        this.picture.src = `/map.png?${query}`;
        this.digits = Math.min(Math.max(1 - Math.floor(Math.log10(frame.pixel)), 0), 6);
        this.read();
      } catch (error) {
        this.say(error.message);
      }
    }

    // World coordinates of a place in the picture, pixels of the picture from its upper left corner.
    world([x, y]) {
      const { corner, pixel } = this.frame;
      const rounded = (value) => Number(value.toFixed(this.digits));
      return [rounded(corner[0] + (x - 0.5) * pixel), rounded(corner[1] - (y - 0.5) * pixel)];
    }

    pixels([x, y]) {
      const { corner, pixel } = this.frame;
      return [(x - corner[0]) / pixel + 0.5, (corner[1] - y) / pixel + 0.5];
    }

    click(event) {
      if (!this.frame) return;
      const box = this.picture.getBoundingClientRect();
      const share = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
      if (share.some((value) => value < 0 || value > 1)) return;
      this.cursor = [share[0] * this.picture.naturalWidth, share[1] * this.picture.naturalHeight];
      this.add();
    }

    key(event) {
      if (!this.frame || event.ctrlKey || event.metaKey || event.altKey) return;
      const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
      const size = [this.picture.naturalWidth, this.picture.naturalHeight];
      const way = ways[event.key];
      if (way) {
        const from = this.cursor || size.map((length) => length / 2);
        const step = event.shiftKey ? 50 : 10;
        this.cursor = from.map((value, axis) => Math.min(Math.max(value + step * way[axis], 0), size[axis]));
        this.say(`Cross at ${this.world(this.cursor).join(', ')}`);
        this.draw();
      } else if (event.key === 'Enter' || event.key === ' ') {
        this.cursor = this.cursor || size.map((length) => length / 2);
        this.add();
      } else if (event.key === '+' || event.key === '=') this.zoom(2);
      else if (event.key === '-') this.zoom(0.5);
      else if (event.key === 'Backspace' || event.key === 'Delete') this.change(this.corners.slice(0, -1));
      else return;
      event.preventDefault();
    }

    add() {
      const corner = this.world(this.cursor);
      this.change([...this.corners, corner]);
    }

    // Enlarges the map by a factor, within a sheet that stays as it is and scrolls; 0 shows all of it.
    zoom(factor) {
      const { sheet, paper, picture } = this;
      const before = this.enlarged;
      this.enlarged = Math.min(Math.max(before * factor, 1), 8);
      if (this.enlarged === before && factor !== 0) return;
      // The place in the middle stays there, that of the cross if there is one.
      const middle = this.cursor
        ? [this.cursor[0] / picture.naturalWidth, this.cursor[1] / picture.naturalHeight]
        : [(sheet.scrollLeft + sheet.clientWidth / 2) / paper.clientWidth, (sheet.scrollTop + sheet.clientHeight / 2) / paper.clientHeight];
      if (this.enlarged === 1) {
        sheet.classList.remove('enlarged');
        for (const part of [sheet, paper]) [part.style.width, part.style.height] = ['', ''];
      } else {
        if (!sheet.classList.contains('enlarged')) this.size = [sheet.offsetWidth, sheet.offsetHeight];
        sheet.classList.add('enlarged');
        [sheet.style.width, sheet.style.height] = this.size.map((length) => `${length}px`);
        [paper.style.width, paper.style.height] = this.size.map((length) => `${length * this.enlarged}px`);
        sheet.scrollTo(
          middle[0] * paper.clientWidth - sheet.clientWidth / 2, middle[1] * paper.clientHeight - sheet.clientHeight / 2,
        );
      }
      this.draw();
    }

    change(corners) {
      this.corners = corners;
      const { least, name, text } = this.kind;
      this.field.value = corners.length >= least ? text(corners) : '';
      const missing = least - corners.length;
      const which = `${this.kind === KINDS.points ? 'Place' : 'Corner'} ${corners.length}`;
      const last = corners.length > 0 ? `${which} at ${corners[corners.length - 1].join(', ')}. ` : '';
      this.unfinished(missing > 0 && corners.length > 0 ? `${missing} more for the ${name}, or remove all` : '');
      this.say(last + (missing > 0 ? `${missing} more for the ${name}.` : `The ${name} ${this.kind === KINDS.points ? 'are' : 'is'} set.`));
      this.draw();
    }

    // Shows what the field says, if it is one of the texts that are written here.
    read() {
      const found = this.field.value.match(/^\s*(?:POLYGON\s*\(\(|LINESTRING\s*\(|(?=[-\d]))([^()]*)\)*\s*$/i);
      const numbers = found ? found[1].split(this.kind === KINDS.points ? '\n' : ',').map((pair) => pair.trim().split(/[\s,;]+/).map(Number)) : [];
      const corners = numbers.filter((pair) => pair.length >= 2 && pair.every(Number.isFinite)).map((pair) => pair.slice(0, 2));
      // The first corner may be repeated at the end, or not.
      const isClosed = corners.length > 1 && corners[0].every((value, axis) => value === corners[corners.length - 1][axis]);
      if (this.kind === KINDS.polygon && isClosed) corners.pop();
      this.corners = corners;
      this.unfinished('');
      this.say('');
      this.draw();
    }

    draw() {
      const { naturalWidth: width, naturalHeight: height, clientWidth: shown } = this.picture;
      if (!this.frame || !width || !shown) return;
      this.svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
      this.svg.replaceChildren();
      const places = this.corners.map((corner) => this.pixels(corner));
      const points = places.map((place) => place.join(',')).join(' ');
      const unit = width / shown;
      const stroke = { 'stroke-width': 2 * unit };
      if (this.kind === KINDS.polygon) element('polygon', { points, class: 'area', ...stroke }, this.svg);
      else if (this.kind === KINDS.line) element('polyline', { points, class: 'line', ...stroke }, this.svg);
      places.forEach(([cx, cy]) => element('circle', { cx, cy, r: 5 * unit, class: 'corner', ...stroke }, this.svg));
      // Positions are named by their numbers in the plan.
      if (this.kind === KINDS.points) {
        places.forEach(([x, y], at) => {
          const number = element('text', { x: x + 9 * unit, y: y + 5 * unit, class: 'number', 'font-size': 16 * unit }, this.svg);
          number.textContent = at + 1;
        });
      }
      if (this.cursor) {
        const [x, y] = this.cursor;
        const arm = 12 * unit;
        const d = `M${x - arm} ${y}H${x + arm}M${x} ${y - arm}V${y + arm}`;
        element('path', { d, class: 'cross', ...stroke }, this.svg);
      }
    }

    // A shape that is drawn in part is not handed in.
    unfinished(message) {
      this.field.setCustomValidity(message);
    }

    say(text) {
      this.status.textContent = text;
    }
  }

  // The scan pattern of the instrument that is chosen.
  function pattern() {
    const list = document.querySelector('select[name=scanner]');
    const picture = document.getElementById('instrument');
    if (!list || !picture) return;
    const show = () => {
      const [option] = list.selectedOptions;
      const address = option && option.dataset.picture;
      picture.hidden = !address;
      if (!address) return;
      picture.src = address;
      picture.alt = `Scan pattern of ${option.textContent.trim()}`;
    };
    const { height } = list.form.elements;
    const offered = () => list.selectedOptions[0]?.dataset.height || '80';
    let before = offered();
    list.addEventListener('change', () => {
      // A height that nobody has typed follows the range of the instrument.
      if (height && height.value === before) height.value = offered();
      before = offered();
      show();
    });
    show();
  }

  pattern();
  document.querySelectorAll('.map').forEach((place) => new Drawing(place));
})();
