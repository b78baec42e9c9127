// The painter: what is drawn, by WebGL.

const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"];

function colourOf(key, isDark) {
  const fixed = {joint: isDark ? "#b8bcc4" : "#6e6e6e", centre: isDark ? "#ffffff" : "#111111"};
  const hex = fixed[key] || COLOURS[key % COLOURS.length];
  return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
}

// Triangles of a box with edges 1, a ball with radius 1, a bar with radius 1 and length 1 along z.
function meshes() {
  const found = {box: [], ball: [], bar: []};
  for (let axis = 0; axis < 3; axis++) {
    for (const side of [-1, 1]) {
      const normal = [0, 0, 0];
      normal[axis] = side;
      const corner = (i, j) => {
        const x = [0, 0, 0];
        x[axis] = side / 2;
        x[(axis + 1) % 3] = i / 2;
        x[(axis + 2) % 3] = j / 2;
        return [...x, ...normal];
      };
      const four = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
      for (const k of [0, 1, 2, 0, 2, 3]) found.box.push(...four[k]);
    }
  }
  const round = 28, rings = 14;
  const onBall = (i, j) => {
    const a = 2 * Math.PI * i / round, b = Math.PI * j / rings;
    const n = [Math.sin(b) * Math.cos(a), Math.sin(b) * Math.sin(a), Math.cos(b)];
    return [...n, ...n];
  };
  for (let i = 0; i < round; i++) {
    for (let j = 0; j < rings; j++) {
      for (const [k, l] of [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]) found.ball.push(...onBall(i + k, j + l));
    }
    const rim = (k, z, n) => {
      const a = 2 * Math.PI * (i + k) / round, c = Math.cos(a), s = Math.sin(a);
      return [c, s, z / 2, ...(n ? [0, 0, n] : [c, s, 0])];
    };
    for (const [k, z] of [[0, -1], [1, -1], [1, 1], [0, -1], [1, 1], [0, 1]]) found.bar.push(...rim(k, z, 0));
    for (const z of [-1, 1]) found.bar.push(0, 0, z / 2, 0, 0, z, ...rim(0, z, z), ...rim(1, z, z));
  }
  return found;
}

const VERTEX = `
attribute vec3 place, normal;
uniform mat4 camera; uniform vec4 turn, level; uniform vec3 at, size; uniform float shadow;
varying vec3 facing;
vec3 turned(vec3 x) { vec3 u = turn.yzw; return x + 2.0 * cross(u, cross(u, x) + turn.x * x); }
void main() {
  vec3 world = turned(place * size) + at;
  world -= shadow * (dot(level.xyz, world) - level.w) * level.xyz;
  facing = turned(normal / max(size, 1e-9));
  gl_Position = camera * vec4(world, 1.0);
}`;
const FRAGMENT = `
precision mediump float;
uniform vec4 colour; uniform vec3 light; uniform float plain;
varying vec3 facing;
void main() {
  float shine = 0.62 + 0.38 * dot(normalize(facing), light);
  gl_FragColor = vec4(colour.rgb * mix(shine, 1.0, plain), colour.a);
}`;

function program(gl) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  gl.useProgram(made);
  const names = ["camera", "turn", "level", "at", "size", "shadow", "colour", "light", "plain"];
  return {made, ...Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(made, name)]))};
}

function buffer(gl, values) {
  const made = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, made);
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(values), gl.STATIC_DRAW);
  return {made, count: values.length / 6};
}

// The directions to the right, up and towards the eye, of a view that turns about what is up.
function directions(data, view) {
  const up = data.up, back = between([0, 0, 1], up);
  const c = Math.cos(view.elevation), s = Math.sin(view.elevation);
  const right = [-Math.sin(view.azimuth), Math.cos(view.azimuth), 0];
  const eye = [c * Math.cos(view.azimuth), c * Math.sin(view.azimuth), s];
  return [right, cross(eye, right), eye].map((x) => turned(back, x));
}

const LENS = 2.6; // the cotangent of half the angle of view

function cameraOf(data, view, wide) {
  const [right, up, eye] = directions(data, view), far = view.distance + 40 * data.radius;
  const near = Math.max(view.distance / 400, view.distance - 40 * data.radius);
  const place = view.centre.map((c, k) => c + view.distance * eye[k]);
  const lens = wide < 1 ? [LENS, LENS * wide] : [LENS / wide, LENS];
  const rows = [
    [...right.map((c) => lens[0] * c), -lens[0] * dot(right, place)],
    [...up.map((c) => lens[1] * c), -lens[1] * dot(up, place)],
    [...eye.map((c) => -c * (far + near) / (far - near)), (dot(eye, place) * (far + near) - 2 * far * near) / (far - near)],
    [...eye.map((c) => -c), dot(eye, place)],
  ];
  return new Float32Array([0, 1, 2, 3].flatMap((k) => rows.map((row) => row[k])));
}

// A grid on the floor, as pairs of points with a normal each.
function gridOf(data) {
  const [right, , forward] = directions(data, {azimuth: -Math.PI / 2, elevation: 0});
  const decade = 10 ** Math.floor(Math.log10(data.radius)), step = data.radius > 4 * decade ? decade : decade / 2;
  const reach = Math.ceil(1.8 * data.radius / step) * step, found = [];
  const middle = data.centre.map((c, k) => c + (data.floor - dot(data.up, data.centre)) * data.up[k]);
  const point = (i, j) => [...middle.map((c, k) => c + i * right[k] + j * forward[k]), ...data.up];
  for (let x = -reach; x <= reach + step / 2; x += step) {
    found.push(...point(x, -reach), ...point(x, reach), ...point(-reach, x), ...point(reach, x));
  }
  return found;
}

function traceOf(data, path) {
  const found = [];
  for (let k = 0; k < path.length; k += 3) found.push(...path.slice(k, k + 3), ...data.up);
  return found;
}

class Painter {
  constructor(canvas, data) {
    this.canvas = canvas;
    this.data = data;
    const gl = this.gl = canvas.getContext("webgl", {antialias: true, alpha: false});
    if (!gl) throw new Error("this browser has no WebGL, which the view needs");
    this.names = program(gl);
    this.kinds = Object.fromEntries(Object.entries(meshes()).map(([name, x]) => [name, buffer(gl, x)]));
    this.grid = buffer(gl, gridOf(data));
    this.traces = data.traces.map((trace) => buffer(gl, traceOf(data, trace)));
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  use({made}) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    ["place", "normal"].forEach((name, k) => {
      const where = gl.getAttribLocation(this.names.made, name);
      gl.enableVertexAttribArray(where);
      gl.vertexAttribPointer(where, 3, gl.FLOAT, false, 24, 12 * k);
    });
  }

  lines(mode, own, colour) {
    const gl = this.gl, names = this.names;
    gl.uniform4f(names.turn, 1, 0, 0, 0);
    gl.uniform3f(names.at, 0, 0, 0);
    gl.uniform3f(names.size, 1, 1, 1);
    gl.uniform1f(names.shadow, 0);
    gl.uniform1f(names.plain, 1);
    gl.uniform4f(names.colour, ...colour);
    this.use(own);
    gl.drawArrays(mode, 0, own.count);
  }

  shape([mesh, key, isClear, at, turn, size], shadow) {
    const gl = this.gl, names = this.names, own = this.kinds[mesh];
    const colour = shadow ? this.dim : [...colourOf(key, this.isDark), isClear ? 0.3 : 1];
    gl.uniform4f(names.turn, ...turn);
    gl.uniform3f(names.at, ...at);
    gl.uniform3f(names.size, ...size);
    gl.uniform1f(names.shadow, shadow ? 1 : 0);
    gl.uniform1f(names.plain, shadow ? 1 : 0);
    gl.uniform4f(names.colour, ...colour);
    this.use(own);
    gl.drawArrays(gl.TRIANGLES, 0, own.count);
  }

  draw(time, view, withInertia) {
    const {gl, canvas, data, names} = this, scale = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * scale), height = Math.round(canvas.clientHeight * scale);
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, {width, height});
    this.isDark = window.matchMedia("(prefers-color-scheme: dark)").matches;
    const back = this.isDark ? [0.086, 0.094, 0.11] : [1, 1, 1];
    this.dim = this.isDark ? [0.05, 0.055, 0.065, 1] : [0.88, 0.88, 0.9, 1];
    gl.viewport(0, 0, width, height);
    gl.clearColor(...back, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const [right, up, eye] = directions(data, view);
    gl.uniformMatrix4fv(names.camera, false, cameraOf(data, view, width / height));
    gl.uniform3f(names.light, ...unit(eye.map((c, k) => c + 0.7 * up[k] - 0.4 * right[k])));
    gl.uniform4f(names.level, ...data.up, data.floor);
    const all = shapesAt(data, time, withInertia), grey = this.isDark ? 0.3 : 0.84;
    const isAbove = dot(eye, data.up) > 0;
    gl.depthMask(false);
    if (isAbove) all.filter((shape) => !shape[2]).forEach((shape) => this.shape(shape, true));
    this.lines(gl.LINES, this.grid, [grey, grey, grey, 1]);
    gl.depthMask(true);
    all.filter((shape) => !shape[2]).forEach((shape) => this.shape(shape, false));
    this.traces.forEach((own) => this.lines(gl.LINE_STRIP, own, [0.84, 0.37, 0, 1]));
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    all.filter((shape) => shape[2]).forEach((shape) => this.shape(shape, false));
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }
}
