// COPC 1.0 (copc.io), read in ranges of bytes: header, pages of the hierarchy, nodes of the octree.

const HEAD_BYTES = 65536;
const HEADER_BYTES = 375;
const VLR_BYTES = 54;
const ENTRY_BYTES = 32;
// Most points and bytes of a node, and bytes of a page of the hierarchy: what is larger is damaged.
const MAX_POINTS = 10e6;
const MAX_NODE_BYTES = 256 * 2 ** 20;
const MAX_PAGE_BYTES = 64 * 2 ** 20;
// Bytes of the data types of extra bytes, by their number in LAS.
const TYPE_BYTES = [0, 1, 1, 2, 2, 4, 4, 8, 8, 4, 8];
// Names of the extra bytes that hold the number of the object, and the amplitude that is more exact than the intensity.
const OBJECT = ['hitObjectId', 'object_id', 'treeID', 'tree_id'];
const AMPLITUDE = ['heliosAmplitude'];

function text(view, at, length) {
  const bytes = new Uint8Array(view.buffer, view.byteOffset + at, length);
  return new TextDecoder('latin1').decode(bytes).split('\0')[0];
}

const damage = () => new Error('the hierarchy of the cloud is damaged');

// Dimensions in the extra bytes: name, type, place in the record.
function extraDimensions(view, at, length, start) {
  const found = [];
  for (let end = at + length; at + 192 <= end; at += 192) {
    const type = view.getUint8(at + 2);
    const size = TYPE_BYTES[type] || view.getUint8(at + 3);
    found.push({ name: text(view, at + 4, 32), type, at: start });
    start += size;
  }
  return found;
}

export class Copc {
  constructor(address) {
    this.address = address;
    // Bytes that were fetched.
    this.bytes = 0;
    this.nodes = new Map();
    // Places of the pages of the hierarchy that were read.
    this.pages = new Set();
  }

  async range(start, length, signal) {
    const headers = { Range: `bytes=${start}-${start + length - 1}` };
    const answer = await fetch(this.address, { headers, signal });
    if (answer.status !== 206) {
      throw new Error(`the points cannot be read: the service answers ${answer.status}`);
    }
    const bytes = await answer.arrayBuffer();
    this.bytes += bytes.byteLength;
    return bytes;
  }

  async open() {
    let view = new DataView(await this.range(0, HEAD_BYTES));
    if (view.byteLength < HEADER_BYTES + VLR_BYTES + 160 || text(view, 0, 4) !== 'LASF'
      || text(view, HEADER_BYTES + 2, 16) !== 'copc') {
      throw new Error('the file is no COPC');
    }
    const start = view.getUint32(96, true);
    if (start > view.byteLength) view = new DataView(await this.range(0, start));
    const f64 = (at) => view.getFloat64(at, true);
    const triple = (at, step = 8) => [f64(at), f64(at + step), f64(at + 2 * step)];
    this.format = view.getUint8(104) & 63;
    this.record = view.getUint16(105, true);
    this.scale = triple(131);
    this.offset = triple(155);
    this.max = triple(179, 16);
    this.min = triple(187, 16);
    this.points = Number(view.getBigUint64(247, true));
    const info = HEADER_BYTES + VLR_BYTES;
    this.centre = triple(info);
    this.half = f64(info + 24);
    this.spacing = f64(info + 32);
    const sizes = [...this.scale, this.half, this.spacing];
    const places = [...this.offset, ...this.min, ...this.max, ...this.centre];
    if (this.points > 0 && !(sizes.every((size) => size > 0) && [...sizes, ...places].every(Number.isFinite))) {
      throw new Error('the header of the cloud is damaged');
    }
    const base = { 6: 30, 7: 36, 8: 38 }[this.format];
    if (!base) throw new Error(`points of format ${this.format} are no COPC`);
    this.extra = [];
    let at = view.getUint16(94, true);
    for (let count = view.getUint32(100, true); count > 0 && at + VLR_BYTES <= start; count -= 1) {
      const length = view.getUint16(at + 20, true);
      if (text(view, at + 2, 16) === 'LASF_Spec' && view.getUint16(at + 18, true) === 4) {
        this.extra = extraDimensions(view, at + VLR_BYTES, Math.min(length, start - at - VLR_BYTES), base);
      }
      at += VLR_BYTES + length;
    }
    const named = (names) => this.extra.find((one) => names.includes(one.name)) || null;
    this.object = named(OBJECT);
    this.amplitude = named(AMPLITUDE);
    await this.page(Number(view.getBigUint64(info + 40, true)), Number(view.getBigUint64(info + 48, true)));
    this.root = this.nodes.get('0-0-0-0') || null;
  }

  // Reads a page of the hierarchy.
  async page(start, length) {
    // A page that leads to itself would be read without end.
    if (!(length >= 0 && length <= MAX_PAGE_BYTES) || this.pages.has(start)) throw damage();
    this.pages.add(start);
    const view = new DataView(await this.range(start, length));
    for (let at = 0; at + ENTRY_BYTES <= view.byteLength; at += ENTRY_BYTES) {
      const [level, x, y, z] = [0, 4, 8, 12].map((from) => view.getInt32(at + from, true));
      const count = view.getInt32(at + 28, true);
      const entry = {
        level, x, y, z, count,
        key: `${level}-${x}-${y}-${z}`,
        start: Number(view.getBigUint64(at + 16, true)),
        length: view.getInt32(at + 24, true),
        // none, loading, ready, failed
        state: 'none',
      };
      if (count < -1 || count > MAX_POINTS || entry.length < 0 || entry.length > MAX_NODE_BYTES) throw damage();
      const known = this.nodes.get(entry.key);
      if (!known || known.count < 0) {
        entry.edge = (2 * this.half) / 2 ** level;
        // Relative to the centre of the root.
        entry.centre = [x, y, z].map((place) => (place + 0.5) * entry.edge - this.half);
        this.nodes.set(entry.key, entry);
      }
    }
  }

  // Replaces an entry that stands for a page of the hierarchy by what the page holds.
  async expand(entry) {
    entry.state = 'loading';
    await this.page(entry.start, entry.length);
  }

  children(node) {
    const found = [];
    for (let octant = 0; octant < 8; octant += 1) {
      const [x, y, z] = [node.x, node.y, node.z].map((place, axis) => 2 * place + ((octant >> axis) & 1));
      const child = this.nodes.get(`${node.level + 1}-${x}-${y}-${z}`);
      if (child) found.push(child);
    }
    return found;
  }
}
