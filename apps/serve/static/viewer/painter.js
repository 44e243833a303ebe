// Draws nodes of points with WebGL 2, and shades them by the depth of their neighbours (eye-dome lighting, Boucheny 2009).

const POINTS_VERTEX = `#version 300 es
uniform mat4 view;
uniform float size;
uniform int colouring;
uniform vec2 heights;
uniform vec2 slab;
uniform int axis;
uniform sampler2D ramps;
uniform sampler2D classes;
in vec3 place;
in uvec4 values;
out vec3 colour;

vec3 ramp(float row, float share) {
  return texture(ramps, vec2(clamp(share, 0.002, 0.998), (row + 0.5) / 3.0)).rgb;
}

void main() {
  gl_Position = view * vec4(place, 1.0);
  gl_PointSize = size;
  if (axis >= 0 && abs(place[axis] - slab.x) > slab.y) {
    gl_Position = vec4(2.0, 2.0, 2.0, 0.0);
  }
  uint number = values.y & 15u;
  uint count = values.y >> 4;
  if (colouring == 0) {
    colour = ramp(0.0, (place.z - heights.x) / (heights.y - heights.x));
  } else if (colouring == 1) {
    colour = ramp(1.0, float(values.z) / 255.0);
  } else if (colouring == 2) {
    colour = count < 2u ? vec3(0.91, 0.88, 0.78) : number < 2u ? vec3(0.35, 0.78, 0.47)
      : number < count ? vec3(0.98, 0.70, 0.25) : vec3(0.36, 0.56, 0.93);
  } else if (colouring == 3) {
    colour = texelFetch(classes, ivec2(values.x, 0), 0).rgb;
  } else {
    colour = ramp(2.0, float(values.w) / 255.0);
  }
}`;

const POINTS_FRAGMENT = `#version 300 es
precision mediump float;
in vec3 colour;
out vec4 shown;

void main() {
  vec2 from = gl_PointCoord - 0.5;
  if (dot(from, from) > 0.25) discard;
  shown = vec4(colour, 1.0);
}`;

const SHADE_VERTEX = `#version 300 es
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  gl_Position = vec4(corner, 0.0, 1.0);
}`;

const SHADE_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D colours;
uniform sampler2D depths;
uniform vec2 planes;
uniform float reach;
out vec4 shown;

float depth(ivec2 at) {
  float stored = texelFetch(depths, clamp(at, ivec2(0), textureSize(depths, 0) - 1), 0).r;
  return stored >= 1.0 ? 0.0 : log2(2.0 * planes.x * planes.y / (planes.y + planes.x - (2.0 * stored - 1.0) * (planes.y - planes.x)));
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec4 colour = texelFetch(colours, at, 0);
  float own = depth(at);
  if (texelFetch(depths, at, 0).r >= 1.0) {
    shown = colour;
    return;
  }
  float hidden = 0.0;
  for (int i = 0; i < 8; i++) {
    float angle = float(i) * 0.7853982;
    ivec2 beside = at + ivec2(round(vec2(cos(angle), sin(angle)) * reach));
    if (texelFetch(depths, clamp(beside, ivec2(0), textureSize(depths, 0) - 1), 0).r < 1.0) {
      hidden += max(0.0, own - depth(beside));
    }
  }
  shown = vec4(colour.rgb * exp(-min(hidden, 0.4) * 5.0), 1.0);
}`;

export const COLOURINGS = ['height', 'intensity', 'return', 'class', 'object'];
export const RETURNS = [['Only return', '#e8e0c7'], ['First', '#59c778'], ['Between', '#fab340'], ['Last', '#5c8fed']];
// Classes of LAS 1.4 by number.
export const CLASSES = {
  0: ['Never classified', '#a5adb5'], 1: ['Unclassified', '#c3c9cf'], 2: ['Ground', '#b0834f'], 3: ['Low vegetation', '#a8d26d'],
  4: ['Medium vegetation', '#63b54a'], 5: ['High vegetation', '#2f8a3c'], 6: ['Building', '#d9534a'], 7: ['Low noise', '#e056c8'],
  9: ['Water', '#4a8fe0'], 10: ['Rail', '#8a6fd1'], 11: ['Road surface', '#8d8d8d'], 14: ['Wire, conductor', '#e5c15a'],
  15: ['Transmission tower', '#d18a4a'], 17: ['Bridge deck', '#b99be0'], 18: ['High noise', '#f08ad8'],
};
export const RAMPS = [
  ['#2b3a9c', '#1f78b8', '#1fa8a0', '#4fc06a', '#b5d34a', '#f3c93f', '#ef8a35', '#d7432f'],
  ['#161a20', '#f2f4f6'],
  ['#e6194b', '#f58231', '#ffe119', '#bfef45', '#3cb44b', '#42d4f4', '#4363d8', '#911eb4', '#f032e6', '#e6194b'],
];
const BACKGROUND = [0.09, 0.114, 0.149];

export function classOf(number) {
  const hue = (number * 137) % 360;
  return CLASSES[number] || [`Class ${number}`, `hsl(${hue} 60% 60%)`];
}

// Paints rows of colours on a canvas, from which a texture is made.
function strip(width, rows) {
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [width, rows.length];
  const paper = canvas.getContext('2d');
  rows.forEach((row, y) => row(paper, y));
  return canvas;
}

function ramps() {
  return strip(256, RAMPS.map((colours) => (paper, y) => {
    const gradient = paper.createLinearGradient(0, 0, 256, 0);
    colours.forEach((colour, i) => gradient.addColorStop(i / (colours.length - 1), colour));
    paper.fillStyle = gradient;
    paper.fillRect(0, y, 256, 1);
  }));
}

function classes() {
  return strip(256, [(paper) => {
    for (let number = 0; number < 256; number += 1) {
      [, paper.fillStyle] = classOf(number);
      paper.fillRect(number, 0, 1, 1);
    }
  }]);
}

export class Painter {
  // Throws if the browser has no WebGL 2.
  constructor(canvas) {
    this.canvas = canvas;
    const gl = canvas.getContext('webgl2', { antialias: false, alpha: false, powerPreference: 'high-performance' });
    if (!gl) throw new Error('this browser has no WebGL 2');
    this.gl = gl;
    this.points = this.program(POINTS_VERTEX, POINTS_FRAGMENT);
    this.shade = this.program(SHADE_VERTEX, SHADE_FRAGMENT);
    this.ramps = this.texture(ramps(), gl.LINEAR);
    this.classes = this.texture(classes(), gl.NEAREST);
    this.empty = gl.createVertexArray();
    this.frame = null;
  }

  program(vertex, fragment) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, 'place');
    gl.bindAttribLocation(program, 1, 'values');
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const names = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i += 1) {
      const { name } = gl.getActiveUniform(program, i);
      names[name] = gl.getUniformLocation(program, name);
    }
    return { program, names };
  }

  texture(source, filter) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, source);
    this.sampling(filter);
    return texture;
  }

  sampling(filter) {
    const { gl } = this;
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  }

  // Gives a node to the graphics card.
  upload({ positions, values }) {
    const { gl } = this;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffers = [positions, values].map((data) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      return buffer;
    });
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[0]);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[1]);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribIPointer(1, 4, gl.UNSIGNED_BYTE, 0, 0);
    gl.bindVertexArray(null);
    return { array, buffers, count: values.length / 4 };
  }

  free({ array, buffers }) {
    this.gl.deleteVertexArray(array);
    buffers.forEach((buffer) => this.gl.deleteBuffer(buffer));
  }

  // The frame that points are drawn to before they are shaded.
  target(width, height) {
    const { gl, frame } = this;
    if (frame && frame.width === width && frame.height === height) return frame;
    if (frame) {
      gl.deleteFramebuffer(frame.buffer);
      [frame.colours, frame.depths].forEach((texture) => gl.deleteTexture(texture));
    }
    const plane = (kind, format, type, internal) => {
      const texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, height, 0, format, type, null);
      this.sampling(gl.NEAREST);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, kind, gl.TEXTURE_2D, texture, 0);
      return texture;
    };
    const buffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    const colours = plane(gl.COLOR_ATTACHMENT0, gl.RGBA, gl.UNSIGNED_BYTE, gl.RGBA8);
    const depths = plane(gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT, gl.DEPTH_COMPONENT24);
    this.frame = { width, height, buffer, colours, depths };
    return this.frame;
  }

  draw(nodes, camera, { colouring, size, heights, slab }) {
    const { gl } = this;
    const { width, height } = this.canvas;
    const frame = this.target(width, height);
    const use = ({ program, names }, textures, set) => {
      gl.useProgram(program);
      textures.forEach(([name, texture], unit) => {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, texture);
        gl.uniform1i(names[name], unit);
      });
      set(names);
    };
    gl.viewport(0, 0, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame.buffer);
    gl.clearColor(...BACKGROUND, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    use(this.points, [['ramps', this.ramps], ['classes', this.classes]], (names) => {
      gl.uniformMatrix4fv(names.view, false, camera.matrix());
      gl.uniform1f(names.size, size);
      gl.uniform1i(names.colouring, COLOURINGS.indexOf(colouring));
      gl.uniform2f(names.heights, ...heights);
      gl.uniform1i(names.axis, slab ? slab.axis : -1);
      gl.uniform2f(names.slab, slab ? slab.at : 0, slab ? slab.half : 0);
    });
    for (const { array, count } of nodes) {
      gl.bindVertexArray(array);
      gl.drawArrays(gl.POINTS, 0, count);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.DEPTH_TEST);
    const { near, far } = camera.planes();
    use(this.shade, [['colours', frame.colours], ['depths', frame.depths]], (names) => {
      gl.uniform2f(names.planes, near, far);
      gl.uniform1f(names.reach, Math.max(1, Math.round(size * 0.75)));
    });
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}
