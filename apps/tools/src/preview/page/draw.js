// WebGL 2: points into a picture with depth, and that picture, shaded, onto the screen.

const canvas = $('view');
const gl = canvas.getContext('webgl2', { antialias: false, alpha: false, depth: false });

const POINTS = [`#version 300 es
uniform mat4 matrix;
uniform float size, least, most, low, high, cut;
uniform int by;
uniform sampler2D colours;
layout(location = 0) in vec3 position;
layout(location = 1) in uvec4 values;
layout(location = 2) in uint object;
layout(location = 3) in uvec4 more;
layout(location = 4) in uint rgb;
flat out vec3 colour;
void main() {
  gl_Position = matrix * vec4(position, 1.0);
  gl_PointSize = clamp(size / gl_Position.w, least, most);
  uint at = object;
  if (by == 0) at = uint(clamp((position.z - low) / (high - low), 0.0, 1.0) * 255.0 + 0.5);
  if (by >= 1 && by <= 3) at = values[by - 1];
  if (by >= 5 && by <= 7) at = more[by - 5];
  if (by == 8) at = rgb;
  vec4 entry = texelFetch(colours, ivec2(at & 255u, at >> 8), 0);
  colour = entry.rgb;
  if (entry.a == 0.0 || position.z > cut) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
}`, `#version 300 es
precision highp float;
flat in vec3 colour;
out vec4 dot_colour;
void main() {
  vec2 off = gl_PointCoord - 0.5;
  if (dot(off, off) > 0.27) discard;
  dot_colour = vec4(colour, 1.0);
}`];

// Eye-dome lighting (Boucheny 2009): a dot is the darker the more its neighbours stand in front of it.
const SHADE = [`#version 300 es
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`, `#version 300 es
precision highp float;
uniform sampler2D picture;
uniform highp sampler2D depths;
uniform vec3 ground;
uniform vec2 range;
uniform float metres, shading, scale;
uniform bool parallel;
out vec4 shown;
float depth(ivec2 at) {
  float d = texelFetch(depths, clamp(at, ivec2(0), textureSize(depths, 0) - 1), 0).r;
  if (d == 1.0) return -1.0;
  return parallel ? mix(range.x, range.y, d) : range.x * range.y / mix(range.y, range.x, d);
}
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  float own = depth(at);
  if (own < 0.0) { shown = vec4(ground, 1.0); return; }
  float dot_width = metres * (parallel ? 1.0 : own), hidden = 0.0;
  for (int ring = 0; ring < 3; ring++) {
    float reach = scale * (ring == 0 ? 1.0 : ring == 1 ? 2.0 : 5.0), weight = ring == 0 ? 0.12 : ring == 1 ? 0.3 : 0.6;
    for (int way = 0; way < 8; way++) {
      float angle = float(way) * 0.7853981634;
      float other = depth(at + ivec2(round(reach * vec2(cos(angle), sin(angle)))));
      if (other > 0.0) hidden += weight * clamp((own - other) / (reach * dot_width) - 0.15, 0.0, 2.5);
    }
  }
  shown = vec4(texelFetch(picture, at, 0).rgb * mix(1.0, 1.12 * exp(-0.11 * hidden), shading), 1.0);
}`];

function program([vertex, fragment]) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) {
    throw new Error('shader: ' + [...gl.getAttachedShaders(made)].map(s => gl.getShaderInfoLog(s)).join(' ') + gl.getProgramInfoLog(made));
  }
  const uniform = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(made, i);
    uniform[name] = gl.getUniformLocation(made, name);
  }
  return { made, uniform };
}

let points, shade, colours, target;

/** Makes what the graphics card needs, also after it has lost everything. */
function prepare() {
  points = program(POINTS);
  shade = program(SHADE);
  colours = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, colours);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, 256, 256);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  target = null;
  blocks.forEach(upload);
}

function upload(block) {
  block.vao = gl.createVertexArray();
  gl.bindVertexArray(block.vao);
  const attribute = (location, data, parts, kind) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(location);
    if (kind === gl.FLOAT) gl.vertexAttribPointer(location, parts, kind, false, 0, 0);
    else gl.vertexAttribIPointer(location, parts, kind, 0, 0);
  };
  attribute(0, block.position, 3, gl.FLOAT);
  attribute(1, block.values, 4, gl.UNSIGNED_BYTE);
  attribute(3, block.more, 4, gl.UNSIGNED_BYTE);
  attribute(2, block.object, 1, gl.UNSIGNED_SHORT);
  attribute(4, block.rgb, 1, gl.UNSIGNED_SHORT);
}

/** The colours of the way that is chosen; an entry without opacity hides its points. */
function colour(table) {
  gl.bindTexture(gl.TEXTURE_2D, colours);
  gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 256, 256, gl.RGBA, gl.UNSIGNED_BYTE, table);
}

function fitTarget(width, height) {
  if (target?.width === width && target.height === height) return;
  if (target) {
    gl.deleteTexture(target.picture);
    gl.deleteTexture(target.depths);
    gl.deleteFramebuffer(target.frame);
  }
  const texture = format => {
    const made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return made;
  };
  const [picture, depths, frame] = [texture(gl.RGBA8), texture(gl.DEPTH_COMPONENT24), gl.createFramebuffer()];
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, picture, 0);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, depths, 0);
  target = { width, height, picture, depths, frame };
}

/** Draws a share of the points as `view` (camera.js) and `look` (main.js) want it. */
function draw(view, look, share) {
  const { width, height } = canvas;
  fitTarget(width, height);
  gl.viewport(0, 0, width, height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
  gl.clearColor(0, 0, 0, 0);
  gl.enable(gl.DEPTH_TEST);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.useProgram(points.made);
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_2D, colours);
  let u = points.uniform;
  gl.uniformMatrix4fv(u.matrix, false, view.matrix);
  // Fewer points are drawn larger.
  gl.uniform1f(u.size, view.dotsPerMetre * meta.spacing * look.size / Math.sqrt(share));
  gl.uniform1f(u.least, look.least);
  gl.uniform1f(u.most, 64);
  gl.uniform1i(u.by, look.by);
  gl.uniform1f(u.low, look.low);
  gl.uniform1f(u.high, look.high);
  gl.uniform1f(u.cut, look.cut);
  gl.uniform1i(u.colours, 0);
  for (const block of blocks) {
    gl.bindVertexArray(block.vao);
    gl.drawArrays(gl.POINTS, 0, Math.ceil(block.count * share));
  }
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.disable(gl.DEPTH_TEST);
  gl.useProgram(shade.made);
  gl.bindTexture(gl.TEXTURE_2D, target.picture);
  gl.activeTexture(gl.TEXTURE1);
  gl.bindTexture(gl.TEXTURE_2D, target.depths);
  gl.activeTexture(gl.TEXTURE0);
  u = shade.uniform;
  gl.uniform1i(u.picture, 0);
  gl.uniform1i(u.depths, 1);
  gl.uniform3fv(u.ground, look.ground);
  gl.uniform2f(u.range, view.near, view.far);
  gl.uniform1f(u.metres, 1 / view.dotsPerMetre);
  gl.uniform1f(u.shading, look.shading ? 1 : 0);
  gl.uniform1f(u.scale, Math.max(1, devicePixelRatio));
  gl.uniform1i(u.parallel, view.parallel ? 1 : 0);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
}
