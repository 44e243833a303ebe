'use strict';
// Decompresses the nodes of a COPC, in a worker without a network: the page hands it the decoder (laz-perf) and the bytes.
importScripts('/static/laz-perf.js');

let laz = null;
// What the header of the cloud tells.
let head = null;
// Intensities that divide those of the root into 256 parts of equal size.
let quantiles = null;
// Points of the root that are shown before all of it is decoded.
const FIRST = 16384;

const READERS = {
  1: 'getUint8', 2: 'getInt8', 3: 'getUint16', 4: 'getInt16', 5: 'getUint32', 6: 'getInt32', 9: 'getFloat32', 10: 'getFloat64',
};

function reader(view, dimension) {
  const name = dimension && READERS[dimension.type];
  if (!name) return null;
  return (record) => view[name](record + dimension.at, true);
}

function rank(value, limits) {
  let [low, high] = [0, 255];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (limits[middle] <= value) low = middle; else high = middle - 1;
  }
  return low;
}

function ranked(values, strengths, limits) {
  for (let i = 0; i < strengths.length; i += 1) values[4 * i + 2] = rank(strengths[i], limits);
  return values;
}

function quantilesOf(values) {
  const sorted = Float32Array.from(values).sort();
  return Float32Array.from({ length: 256 }, (_, i) => sorted[Math.floor((i * (sorted.length - 1)) / 256)]);
}

// Positions relative to the centre of the root, and four bytes for each point: class, return number and number of returns, rank of
// the intensity, object. Those of the first points of the root are given to `begin` before.
function decode(bytes, count, begin) {
  const { format, record, scale, offset, centre } = head;
  const [input, output] = [laz._malloc(bytes.byteLength), laz._malloc(record)];
  const decoder = new laz.ChunkDecoder();
  try {
    laz.HEAPU8.set(new Uint8Array(bytes), input);
    decoder.open(format, record, input);
    const positions = new Float32Array(3 * count);
    const values = new Uint8Array(4 * count);
    const strengths = new Float32Array(count);
    const shift = offset.map((value, axis) => value - centre[axis]);
    let view = new DataView(laz.HEAPU8.buffer, output, record);
    let [amplitude, object] = [reader(view, head.amplitude), reader(view, head.object)];
    for (let i = 0; i < count; i += 1) {
      if (i === FIRST && !quantiles) {
        const known = strengths.subarray(0, i);
        begin(positions.slice(0, 3 * i), ranked(values.slice(0, 4 * i), known, quantilesOf(known)));
      }
      decoder.getPoint(output);
      if (view.buffer !== laz.HEAPU8.buffer) {
        // The memory has grown.
        view = new DataView(laz.HEAPU8.buffer, output, record);
        [amplitude, object] = [reader(view, head.amplitude), reader(view, head.object)];
      }
      for (let axis = 0; axis < 3; axis += 1) {
        positions[3 * i + axis] = view.getInt32(4 * axis, true) * scale[axis] + shift[axis];
      }
      strengths[i] = amplitude ? amplitude(0) : view.getUint16(12, true);
      values[4 * i] = view.getUint8(16);
      values[4 * i + 1] = view.getUint8(14);
      // Neighbouring numbers get colours that differ.
      values[4 * i + 3] = object ? Math.imul(object(0), 0x9e3779b1) >>> 24 : 0;
    }
    if (!quantiles) quantiles = quantilesOf(strengths);
    return { positions, values: ranked(values, strengths, quantiles) };
  } finally {
    decoder.delete();
    laz._free(input);
    laz._free(output);
  }
}

self.onmessage = async ({ data }) => {
  if (data.wasm) {
    try {
      laz = await createLazPerf({ wasmBinary: data.wasm });
      self.postMessage({ ready: true });
    } catch (error) {
      self.postMessage({ failure: String(error) });
    }
    return;
  }
  if (data.quantiles) {
    quantiles = data.quantiles;
    return;
  }
  ({ head } = data);
  try {
    const isFirst = !quantiles;
    const begin = (positions, values) => {
      self.postMessage({ key: data.key, positions, values, isPart: true }, [positions.buffer, values.buffer]);
    };
    const { positions, values } = decode(data.bytes, data.count, begin);
    const message = { key: data.key, positions, values, quantiles: isFirst ? quantiles : null };
    self.postMessage(message, [positions.buffer, values.buffer]);
  } catch (error) {
    self.postMessage({ key: data.key, failure: String(error) });
  }
};
