// The points as they lie in the page, and what becomes of them on the way to the graphics card.

const meta = JSON.parse(document.getElementById('meta').textContent);
const page = document.documentElement;
const $ = id => document.getElementById(id);

/** Says what went wrong, where a reader and a test see it. */
function fail(message) {
  page.dataset.state = 'error';
  $('status').textContent = message;
}
addEventListener('error', e => fail(e.message));
addEventListener('unhandledrejection', e => fail(String(e.reason?.message ?? e.reason)));

/** Blocks that are loaded: {count, position, values, more, object, rgb, vao}. Positions are metres from the middle of the cloud. */
const blocks = [];
const half = meta.size.map(s => s / 2);

async function bytesOf(text) {
  const packed = Uint8Array.fromBase64 ? Uint8Array.fromBase64(text) : Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * Undoes the packing: per coordinate three planes of bytes with zigzag differences, then a plane each of intensity,
 * class, return number, two of the object, a plane each of leg, channel and time, and two of the colour, where the cloud has them. Points lie along a curve that fills space; they
 * are dealt out so that any first part of a block is an even sample of it.
 */
function unpack(planes, count) {
  let at = 0;
  const plane = () => planes.subarray(at, at += count);
  const position = new Float32Array(3 * count);
  let stride = Math.max(1, Math.round(count * 0.6180339887)) | 1;
  while (common(stride, count) !== 1) stride += 2;
  stride %= count;
  for (let axis = 0; axis < 3; axis++) {
    const [low, middle, high] = [plane(), plane(), plane()];
    let value = 0;
    for (let i = 0, to = 0; i < count; i++) {
      const zigzag = low[i] | middle[i] << 8 | high[i] << 16;
      value += zigzag >>> 1 ^ -(zigzag & 1);
      position[3 * to + axis] = value * meta.step - half[axis];
      to += stride;
      if (to >= count) to -= count;
    }
  }
  const deal = (target, width, column) => {
    const source = plane();
    for (let i = 0, to = 0; i < count; i++) {
      target[width * to + column] = source[i];
      to += stride;
      if (to >= count) to -= count;
    }
  };
  const values = new Uint8Array(4 * count);
  if (meta.intensity) deal(values, 4, 0);
  if (meta.class) deal(values, 4, 1);
  if (meta.return) deal(values, 4, 2);
  const object = new Uint8Array(2 * count);
  if (meta.object) { deal(object, 2, 0); deal(object, 2, 1); }
  const more = new Uint8Array(4 * count);
  if (meta.leg) deal(more, 4, 0);
  if (meta.channel) deal(more, 4, 1);
  if (meta.time) deal(more, 4, 2);
  const rgb = new Uint8Array(2 * count);
  if (meta.rgb) { deal(rgb, 2, 0); deal(rgb, 2, 1); }
  return { count, position, values, more, object: new Uint16Array(object.buffer), rgb: new Uint16Array(rgb.buffer) };
}

function common(a, b) {
  while (b) [a, b] = [b, a % b];
  return a;
}

/** Loads all blocks one after the other; the page stays usable and shows what there is. */
async function load(upload) {
  let loaded = 0, shown = 0;
  for (const script of [...document.querySelectorAll('script.block')]) {
    const count = Number(script.dataset.count);
    const block = unpack(await bytesOf(script.textContent), count);
    script.remove();
    upload(block);
    blocks.push(block);
    loaded += count;
    $('progress').value = loaded / meta.shown;
    // Not every block is worth a picture: drawing all that is there takes longer each time.
    if (loaded > 1.6 * shown) {
      shown = loaded;
      redraw();
    }
  }
}
