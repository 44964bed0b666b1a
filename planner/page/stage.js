// Draws triangles, lines and labels with WebGL 2, seen by a camera that turns around a point. Column-major matrices;
// lengths in metres, z is up.
"use strict";

const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const l = Math.hypot(...a) || 1; return a.map((x) => x / l); };

function times(a, b) { // the product of two matrices
  const c = new Float32Array(16);
  for (let i = 0; i < 4; i++) for (let j = 0; j < 4; j++) for (let k = 0; k < 4; k++) c[4 * i + j] += b[4 * i + k] * a[4 * k + j];
  return c;
}

function placed(p) { // the matrix of a pose x y z, qx qy qz qw
  const [x, y, z, w] = [p[3], p[4], p[5], p[6]];
  return new Float32Array([
    1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w), 0,
    2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w), 0,
    2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y), 0, p[0], p[1], p[2], 1]);
}

function drawnIn(mesh, inset) { // the matrix that draws a mesh together on each side, by at most half of its width
  const halves = mesh.high.map((high, i) => (high - mesh.low[i]) / 2);
  const [a, b, c] = halves.map((half) => 1 - Math.min(inset, half / 2) / Math.max(half, 1e-9));
  const shift = [a, b, c].map((scale, i) => (1 - scale) * (mesh.low[i] + mesh.high[i]) / 2);
  return new Float32Array([a, 0, 0, 0, 0, b, 0, 0, 0, 0, c, 0, ...shift, 1]);
}

const MESH = [`#version 300 es
uniform mat4 view, place; in vec3 position, normal; out vec3 n, at;
void main() { vec4 w = place * vec4(position, 1.0); at = w.xyz; n = mat3(place) * normal; gl_Position = view * w; }`,
`#version 300 es
precision highp float; uniform vec4 color; uniform vec3 eye; in vec3 n, at; out vec4 seen;
void main() {
  vec3 m = normalize(n), to = normalize(eye - at); m = dot(m, to) < 0.0 ? -m : m;
  float light = 0.52 + 0.16 * m.z + 0.30 * max(dot(m, normalize(vec3(0.4, -0.5, 0.8))), 0.0) + 0.12 * dot(m, to);
  seen = vec4(color.rgb * light * color.a, color.a); }`];
const LINE = [`#version 300 es
uniform mat4 view; uniform vec2 size; uniform float width; in vec3 a, b, tint; in vec2 corner; out vec3 c;
void main() {
  vec4 p = view * vec4(a, 1.0), q = view * vec4(b, 1.0);
  float before = p.z + p.w, after = q.z + q.w; // below zero in front of the nearest plane, where a line ends
  if (before < 0.0 && after > 0.0) p = mix(p, q, before / (before - after));
  if (after < 0.0 && before > 0.0) q = mix(q, p, after / (after - before));
  vec4 at = corner.x < 0.5 ? p : q;
  vec2 along = (q.xy / max(q.w, 1e-3) - p.xy / max(p.w, 1e-3)) * size; along /= max(length(along), 1e-6);
  gl_Position = at + vec4(vec2(-along.y, along.x) * corner.y * width / size * at.w, -2e-4 * at.w, 0.0); c = tint; }`,
`#version 300 es
precision highp float; in vec3 c; out vec4 seen; void main() { seen = vec4(c, 1.0); }`];

class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: location.hash !== "#film", alpha: true, preserveDrawingBuffer: true });
    if (!this.gl) throw new Error("this browser draws no WebGL 2");
    this.mesh = this.program(...MESH);
    this.line = this.program(...LINE);
    this.solids = []; // of { mesh, place(), color, alpha, visible() }
    this.strips = []; // of { lines, width }
    this.follow();
  }

  program(...sources) {
    const gl = this.gl, made = gl.createProgram();
    sources.forEach((text, i) => {
      const shader = gl.createShader(i ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
      gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(made, shader);
    });
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    return made;
  }

  arrays(program, layout, data, indices) { // [name, floats] in turn
    const gl = this.gl, made = gl.createVertexArray(), stride = 4 * layout.reduce((sum, [, n]) => sum + n, 0);
    gl.bindVertexArray(made);
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    let at = 0;
    for (const [name, n] of layout) {
      const where = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(where);
      gl.vertexAttribPointer(where, n, gl.FLOAT, false, stride, at);
      at += 4 * n;
    }
    if (indices) {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    }
    gl.bindVertexArray(null);
    return { made, buffer };
  }

  triangles(points, indices) { // with the normals of the faces around each corner
    const normals = new Float32Array(points.length), both = new Float32Array(2 * points.length);
    const at = (i) => [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
    for (let f = 0; f < indices.length; f += 3) {
      const a = at(indices[f]), n = cross(sub(at(indices[f + 1]), a), sub(at(indices[f + 2]), a));
      for (let k = 0; k < 3; k++) for (let i = 0; i < 3; i++) normals[3 * indices[f + k] + i] += n[i];
    }
    for (let i = 0; i < points.length; i += 3) {
      const n = unit([normals[i], normals[i + 1], normals[i + 2]]);
      for (let k = 0; k < 3; k++) { both[2 * i + k] = points[i + k]; both[2 * i + 3 + k] = n[k]; }
    }
    return { ...this.arrays(this.mesh, [["position", 3], ["normal", 3]], both, indices), count: indices.length };
  }

  segments(points, colors) { // pairs of points, a colour 0 to 1 for each point
    const made = this.arrays(this.line, [["a", 3], ["b", 3], ["tint", 3], ["corner", 2]], this.ribbon(points, colors));
    return { ...made, count: 3 * points.length };
  }

  replace(lines, points, colors) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, lines.buffer);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, this.ribbon(points, colors), this.gl.DYNAMIC_DRAW);
    lines.count = 3 * points.length;
  }

  ribbon(points, colors) {
    const data = [];
    for (let i = 0; i < points.length; i += 2) {
      for (const [end, side] of [[0, -1], [1, -1], [1, 1], [0, -1], [1, 1], [0, 1]]) {
        data.push(...points[i], ...points[i + 1], ...colors[i + end], end, side);
      }
    }
    return new Float32Array(data);
  }

  look(eye, target, fov, aspect) { // for a picture of this width by its height
    const d = sub(eye, target);
    this.target = [...target]; this.far = Math.hypot(...d);
    this.azimuth = Math.atan2(d[1], d[0]); this.elevation = Math.asin(d[2] / this.far);
    this.fov = fov; this.aspect = aspect;
  }

  get ahead() {
    const c = Math.cos(this.elevation);
    return [-c * Math.cos(this.azimuth), -c * Math.sin(this.azimuth), -Math.sin(this.elevation)];
  }

  camera() {
    const { canvas, target, far, ahead } = this, right = [-Math.sin(this.azimuth), Math.cos(this.azimuth), 0];
    const up = cross(right, ahead), eye = target.map((x, i) => x - far * ahead[i]);
    const shape = canvas.width / canvas.height, near = 0.02 * far, most = 20 * far + 10;
    const t = 1 / (Math.tan(this.fov / 2) * Math.max(1, this.aspect / shape));
    const seen = new Float32Array([right[0], up[0], -ahead[0], 0, right[1], up[1], -ahead[1], 0, right[2], up[2], -ahead[2], 0,
      -dot(right, eye), -dot(up, eye), dot(ahead, eye), 1]);
    const lens = new Float32Array([t / shape, 0, 0, 0, 0, t, 0, 0, 0, 0, (most + near) / (near - most), -1, 0, 0, 2 * most * near / (near - most), 0]);
    this.right = right; this.up = up; this.eye = eye; this.view = times(lens, seen);
  }

  onScreen(p) { // of the canvas, 0 to 1 from the upper left; null behind the eye
    const v = this.view, w = v[3] * p[0] + v[7] * p[1] + v[11] * p[2] + v[15];
    if (w <= 0) return null;
    const part = (r) => (v[r] * p[0] + v[r + 4] * p[1] + v[r + 8] * p[2] + v[r + 12]) / w;
    return [0.5 + 0.5 * part(0), 0.5 - 0.5 * part(1)];
  }

  draw() {
    const { gl, canvas } = this;
    this.camera();
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST); gl.depthFunc(gl.LEQUAL); gl.enable(gl.BLEND); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.useProgram(this.line);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.line, "view"), false, this.view);
    gl.uniform2f(gl.getUniformLocation(this.line, "size"), canvas.width, canvas.height);
    for (const { lines, width } of this.strips) {
      if (!lines.count) continue;
      gl.uniform1f(gl.getUniformLocation(this.line, "width"), width * (window.devicePixelRatio || 1));
      gl.bindVertexArray(lines.made); gl.drawArrays(gl.TRIANGLES, 0, lines.count);
    }
    gl.useProgram(this.mesh);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.mesh, "view"), false, this.view);
    gl.uniform3fv(gl.getUniformLocation(this.mesh, "eye"), this.eye);
    const shown = this.solids.filter((x) => !x.visible || x.visible());
    for (const x of shown) if (x.alpha === 1) this.solid(x);
    for (const only of new Set(shown.filter((x) => x.alpha < 1).map((x) => x.group))) { // the front of each ghost
      const parts = shown.filter((x) => x.group === only);
      gl.colorMask(false, false, false, false); parts.forEach((x) => this.solid(x));
      gl.colorMask(true, true, true, true); parts.forEach((x) => this.solid(x));
    }
    gl.bindVertexArray(null);
  }

  solid({ mesh, place, color, alpha }) {
    const gl = this.gl;
    gl.uniformMatrix4fv(gl.getUniformLocation(this.mesh, "place"), false, place());
    gl.uniform4f(gl.getUniformLocation(this.mesh, "color"), ...color, alpha);
    gl.bindVertexArray(mesh.made); gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
  }

  follow() { // drag: turn; with the right button, shift or two fingers: move; wheel, pinch: nearer
    const held = new Map(), canvas = this.canvas;
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, event); });
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => held.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const x = event.clientX - before.clientX, y = event.clientY - before.clientY;
      const other = [...held.values()].find((each) => each.pointerId !== event.pointerId);
      if (other) {
        const gap = (e) => Math.hypot(e.clientX - other.clientX, e.clientY - other.clientY);
        this.far *= Math.max(gap(before), 1) / Math.max(gap(event), 1);
      }
      if (other || event.shiftKey || event.buttons & 2) {
        const step = this.far * Math.tan(this.fov / 2) * 2 / canvas.clientHeight / (other ? 2 : 1);
        this.target = this.target.map((v, i) => v - step * x * this.right[i] + step * y * this.up[i]);
      } else {
        this.azimuth -= 0.008 * x;
        this.elevation = Math.min(Math.max(this.elevation + 0.008 * y, -1.55), 1.55);
      }
      held.set(event.pointerId, event);
      this.moved();
    });
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.far *= Math.exp(0.001 * event.deltaY); this.moved(); }, { passive: false });
  }

  moved() {} // replaced by who draws
}
