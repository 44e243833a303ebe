// A camera that turns around a point. Columns of matrices follow each other, as in WebGL; z is up.

const FIELD = Math.PI / 4;
// Share of the picture that the whole cloud takes.
const MARGIN = 0.96;
// Angle to the horizon, so that up stays up.
const STEEPEST = Math.PI / 2 - 1e-3;

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const sum = (a, b, factor = 1) => a.map((value, axis) => value + factor * b[axis]);
const unit = (a) => a.map((value) => value / Math.hypot(...a));

export class Camera {
  constructor() {
    this.width = 1;
    this.height = 1;
  }

  // Shows a box from a direction (radians): from the south, from above.
  show(min, max, heading = -0.5, pitch = 0.7) {
    this.target = min.map((value, axis) => (value + max[axis]) / 2);
    this.size = Math.max(Math.hypot(...max.map((value, axis) => value - min[axis])), 0.1);
    this.heading = heading;
    this.pitch = Math.min(Math.max(pitch, -STEEPEST), STEEPEST);
    // So far away that all corners are seen.
    const { back, across, upward } = this.axes();
    const half = MARGIN * Math.tan(FIELD / 2);
    const needs = [0, 1, 2, 3, 4, 5, 6, 7].map((octant) => {
      const corner = sum(min.map((_, axis) => ((octant >> axis) & 1 ? max : min)[axis]), this.target, -1);
      const aside = Math.max(Math.abs(dot(upward, corner)), (Math.abs(dot(across, corner)) * this.height) / this.width);
      return dot(back, corner) + aside / half;
    });
    this.distance = Math.max(...needs, 0.1);
  }

  turn(right, up) {
    this.heading -= right;
    this.pitch = Math.min(Math.max(this.pitch + up, -STEEPEST), STEEPEST);
  }

  // Moves by pixels.
  pan(right, up) {
    const step = (2 * Math.tan(FIELD / 2) * this.distance) / this.height;
    const { across, upward } = this.axes();
    this.target = sum(sum(this.target, across, -right * step), upward, up * step);
  }

  zoom(factor) {
    this.distance = Math.min(Math.max(this.distance * factor, this.size * 1e-4), this.size * 20);
  }

  axes() {
    const flat = Math.cos(this.pitch);
    // From the target to the eye.
    const back = [Math.sin(this.heading) * flat, -Math.cos(this.heading) * flat, Math.sin(this.pitch)];
    const across = unit(cross([0, 0, 1], back));
    return { back, across, upward: cross(back, across) };
  }

  eye() {
    return sum(this.target, this.axes().back, this.distance);
  }

  // Metres per pixel at the point around which the camera turns.
  metres() {
    return (2 * Math.tan(FIELD / 2) * this.distance) / this.height;
  }

  // Pixels per metre at a distance of one metre.
  pixels() {
    return this.height / (2 * Math.tan(FIELD / 2));
  }

  planes() {
    const far = this.distance + 2 * this.size;
    return { near: Math.max(this.distance - 2 * this.size, far * 1e-4), far };
  }

  matrix() {
    const { back, across, upward } = this.axes();
    const eye = this.eye();
    const { near, far } = this.planes();
    const tall = 1 / Math.tan(FIELD / 2);
    const wide = (tall * this.height) / this.width;
    const deep = (far + near) / (near - far);
    const rows = [across, upward, back].map((axis) => [...axis, -dot(axis, eye)]);
    const matrix = new Float32Array(16);
    for (let column = 0; column < 4; column += 1) {
      matrix[4 * column] = wide * rows[0][column];
      matrix[4 * column + 1] = tall * rows[1][column];
      matrix[4 * column + 2] = deep * rows[2][column] + (column === 3 ? (2 * far * near) / (near - far) : 0);
      matrix[4 * column + 3] = -rows[2][column];
    }
    return matrix;
  }

  // Whether a ball may be in the picture.
  sees(centre, radius) {
    const { back, across, upward } = this.axes();
    const from = sum(centre, this.eye(), -1);
    const depth = -dot(from, back);
    if (depth < -radius) return false;
    const tall = Math.tan(FIELD / 2);
    const wide = (tall * this.width) / this.height;
    const beside = (offset, slope) => Math.abs(offset) > slope * depth + radius * Math.hypot(1, slope);
    return !beside(dot(from, across), wide) && !beside(dot(from, upward), tall);
  }
}
