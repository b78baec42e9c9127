// The motion: decoding, and where bodies and points are between two frames.

function numbers(text, Kind) {
  const raw = atob(text);
  const bytes = Uint8Array.from(raw, (c) => c.charCodeAt(0));
  return new Kind(bytes.buffer);
}

function decoded(motion) {
  return {
    ...motion,
    t: numbers(motion.t, Float64Array),
    poses: numbers(motion.poses, Float32Array),
    points: numbers(motion.points, Float32Array),
    traces: motion.traces.map((path) => numbers(path, Float32Array)),
  };
}

// The frame at or before a time, and how far it is on the way to the next.
function frameAt(t, time) {
  const way = Math.sign(t[t.length - 1] - t[0]) || 1;
  let low = 0, high = t.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (way * (t[middle] - time) <= 0) low = middle; else high = middle;
  }
  const part = high > low ? (time - t[low]) / (t[high] - t[low]) : 0;
  return [low, Math.min(1, Math.max(0, part))];
}

// Place and quaternion of a body; the ground comes after all others and stands still.
function poseAt(data, body, frame, part) {
  if (body >= data.names.length) return [0, 0, 0, 1, 0, 0, 0];
  const size = 7 * data.names.length, from = frame * size + 7 * body;
  const to = frame + 1 < data.t.length ? from + size : from;
  const a = data.poses.subarray(from, from + 7), b = data.poses.subarray(to, to + 7);
  const found = Array.from(a);
  let side = 0;
  for (let k = 3; k < 7; k++) side += a[k] * b[k];
  const sign = side < 0 ? -1 : 1;
  for (let k = 0; k < 3; k++) found[k] += part * (b[k] - a[k]);
  for (let k = 3; k < 7; k++) found[k] += part * (sign * b[k] - a[k]);
  const norm = Math.hypot(...found.slice(3)) || 1;
  for (let k = 3; k < 7; k++) found[k] /= norm;
  return found;
}

function pointAt(data, point, frame, part) {
  const from = 3 * (frame * data.count + point);
  const to = frame + 1 < data.t.length ? from + 3 * data.count : from;
  return [0, 1, 2].map((k) => data.points[from + k] + part * (data.points[to + k] - data.points[from + k]));
}

// Quaternions (w, x, y, z) and vectors.

function product(a, b) {
  return [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3],
    a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1],
  ];
}

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function turned(e, x) {
  const u = e.slice(1), twice = cross(u, x).map((c) => 2 * c), more = cross(u, twice);
  return x.map((c, k) => c + e[0] * twice[k] + more[k]);
}

function placed(pose, x) {
  return turned(pose.slice(3), x).map((c, k) => c + pose[k]);
}

function unit(a) {
  const size = Math.hypot(...a) || 1;
  return a.map((c) => c / size);
}

// The quaternion of the least turn between two directions.
function between(a, b) {
  const w = 1 + dot(a, b);
  if (w < 1e-9) return [0, ...unit(cross(a, Math.abs(a[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]))];
  const found = [w, ...cross(a, b)], size = Math.hypot(...found);
  return found.map((c) => c / size);
}

// A bar between two points: its middle, quaternion and sizes.
function barBetween(a, b, radius) {
  const along = b.map((c, k) => c - a[k]), length = Math.hypot(...along);
  const turn = length ? between([0, 0, 1], along.map((c) => c / length)) : [1, 0, 0, 0];
  return [a.map((c, k) => (c + b[k]) / 2), turn, [radius, radius, length]];
}

// Everything to draw at a time: [mesh, colour, see-through, place, quaternion, sizes].
function shapesAt(data, time, withInertia) {
  const [frame, part] = frameAt(data.t, time), shapes = [];
  const poses = Array.from({length: data.names.length + 1}, (_, k) => poseAt(data, k, frame, part));
  for (const {role, mesh, body, at, turn, size} of data.parts) {
    if ((role === "inertia" || role === "centre") && !withInertia) continue;
    const pose = poses[body];
    const isGrey = role === "joint" || body === data.names.length;
    const colour = isGrey ? "joint" : role === "centre" ? "centre" : body;
    shapes.push([mesh, colour, role === "inertia" || role === "plane", placed(pose, at), product(pose.slice(3), turn), size]);
  }
  for (const [a, first, b, second] of data.springs) {
    const bar = barBetween(placed(poses[a], first), placed(poses[b], second), 0.6 * data.thick);
    shapes.push(["bar", "joint", false, ...bar]);
  }
  data.lines.forEach(([start, size], line) => {
    let last = null;
    for (let k = start; k < start + size; k++) {
      const here = pointAt(data, k, frame, part);
      if (last) shapes.push(["bar", line, false, ...barBetween(last, here, data.thick)]);
      const radius = (size <= 12 ? 1.8 : 1) * data.thick;
      shapes.push(["ball", size <= 12 ? "joint" : line, false, here, [1, 0, 0, 0], [radius, radius, radius]]);
      last = here;
    }
  });
  return shapes;
}
