// Where the viewer stands. z is up; the heading is that of the view, clockwise from north.

const FIELD = 40 * Math.PI / 180;
const radius = Math.max(0.5 * Math.hypot(...meta.size), 1e-3);
const camera = { target: [0, 0, 0], distance: 1, heading: 0, down: 0, parallel: false };

function look(heading, down) {
  camera.heading = heading;
  camera.down = down;
  // All of the box, seen from there, with room for the panels.
  camera.target = [0, 0, 0];
  camera.distance = 1;
  const { right, up, forward } = axes();
  const aspect = canvas.clientWidth / Math.max(1, canvas.clientHeight), slope = Math.tan(FIELD / 2) / 1.06;
  // In perspective every corner asks for a distance of its own: near ones are seen larger.
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map(n => half.map((h, i) => n >> i & 1 ? h : -h));
  const needed = corners.map(corner => {
    const reach = Math.max(Math.abs(along(up, corner)), Math.abs(along(right, corner)) / aspect);
    return reach / slope - (camera.parallel ? 0 : along(forward, corner));
  });
  camera.distance = Math.max(...needed, 1e-3);
}

function axes() {
  const [sh, ch] = [Math.sin(camera.heading), Math.cos(camera.heading)];
  const [sd, cd] = [Math.sin(camera.down), Math.cos(camera.down)];
  return { right: [ch, -sh, 0], up: [sh * sd, ch * sd, cd], forward: [sh * cd, ch * cd, -sd] };
}

const along = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** What the shaders need. `dotsPerMetre` holds at the distance 1 (perspective) or everywhere (parallel). */
function viewOf(width, height) {
  const { right, up, forward } = axes();
  const eye = camera.target.map((t, i) => t - camera.distance * forward[i]);
  const middle = -along(forward, eye);
  const far = Math.max(middle + radius * 1.01, radius * 0.01);
  const near = camera.parallel ? middle - radius * 1.01 : Math.max(middle - radius * 1.01, Math.min(far, camera.distance) * 0.01);
  const zoom = 1 / Math.tan(FIELD / 2);
  const scale = camera.parallel ? zoom / camera.distance : zoom;
  const [a, b] = camera.parallel
    ? [2 / (far - near), -(far + near) / (far - near)]
    : [(far + near) / (far - near), -2 * far * near / (far - near)];
  const row = (axis, factor) => [...axis.map(part => part * factor), -along(axis, eye) * factor];
  const x = row(right, scale * height / width), y = row(up, scale), z = row(forward, a), w = row(forward, 1);
  z[3] += b;
  const last = camera.parallel ? [0, 0, 0, 1] : w;
  const matrix = new Float32Array([0, 1, 2, 3].flatMap(i => [x[i], y[i], z[i], last[i]]));
  return { matrix, near, far, parallel: camera.parallel, dotsPerMetre: scale * height / 2 };
}

/** Metres that a CSS pixel covers at the distance of the point that the view turns about. */
const metresPerPixel = () => 2 * camera.distance * Math.tan(FIELD / 2) / Math.max(1, canvas.clientHeight);

function turn(dx, dy) {
  camera.heading += dx;
  camera.down = Math.min(Math.max(camera.down + dy, -Math.PI / 2), Math.PI / 2);
}

function move(dx, dy) {
  const { right, up } = axes(), metres = metresPerPixel();
  camera.target = camera.target.map((t, i) => t - (dx * right[i] - dy * up[i]) * metres);
}

/** Zooms so that what is under the pointer (CSS pixels from the middle) stays there. */
function zoom(factor, x = 0, y = 0) {
  const before = camera.distance;
  camera.distance = Math.min(Math.max(before * factor, radius * 1e-5), radius * 50);
  const rest = 1 - camera.distance / before, metres = 2 * before * Math.tan(FIELD / 2) / Math.max(1, canvas.clientHeight);
  const { right, up } = axes();
  camera.target = camera.target.map((t, i) => t + (x * right[i] - y * up[i]) * metres * rest);
}

/** The nearest point that is shown within a few pixels of a place on the canvas: {block, at} or null. */
function pick(px, py, isShown) {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const m = viewOf(width, height).matrix;
  let best = null, nearest = Infinity;
  for (const block of blocks) {
    const p = block.position;
    for (let i = 0; i < block.count; i++) {
      const [x, y, z] = [p[3 * i], p[3 * i + 1], p[3 * i + 2]];
      const w = m[3] * x + m[7] * y + m[11] * z + m[15];
      if (w <= 0) continue;
      const sx = ((m[0] * x + m[4] * y + m[8] * z + m[12]) / w * 0.5 + 0.5) * width - px;
      const sy = (0.5 - (m[1] * x + m[5] * y + m[9] * z + m[13]) / w * 0.5) * height - py;
      const off = sx * sx + sy * sy;
      if (off > 64) continue;
      const depth = (m[2] * x + m[6] * y + m[10] * z + m[14]) / w + off * 1e-6;
      if (depth >= -1 && depth < nearest && isShown(block, i)) [best, nearest] = [{ block, at: i }, depth];
    }
  }
  return best;
}
