// The controls: time, speed, and the view by mouse, fingers and keys.

function start(data) {
  const find = (id) => document.getElementById(id);
  const canvas = find("scene"), slider = find("time"), clock = find("clock"), play = find("play");
  const first = data.t[0], last = data.t[data.t.length - 1];
  const isFramed = window.self !== window.top;
  const home = {azimuth: data.view[0], elevation: data.view[1], distance: 2.6 * data.radius, centre: data.centre};
  let view = {...home}, time = first, before = null, isDirty = true;
  let isPlaying = !window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  const painter = new Painter(canvas, data);
  // one finger turns; in a frame of a page it scrolls up and down
  if (isFramed) canvas.style.touchAction = "pan-y";
  if (!data.parts.some((part) => part.role === "inertia")) find("choice").hidden = true;

  function show() {
    slider.value = last === first ? 0 : (time - first) / (last - first);
    clock.textContent = "t = " + time.toFixed(data.digits) + data.unit;
    play.textContent = isPlaying ? "\u275a\u275a" : "\u25b6";
    painter.draw(time, view, find("inertia").checked);
    isDirty = false;
  }

  function tick(now) {
    if (isPlaying && before !== null) {
      const passed = Math.min(now - before, 100) / 1000 * Number(find("speed").value);
      time += passed * (last - first) / data.seconds;
      if ((last - first) * (time - last) > 0) time = first;
      isDirty = true;
    }
    before = now;
    if (isDirty) show();
    window.requestAnimationFrame(tick);
  }

  function change(values) {
    Object.assign(view, values);
    view.elevation = Math.max(-1.55, Math.min(1.55, view.elevation));
    view.distance = Math.max(home.distance / 50, Math.min(home.distance * 20, view.distance));
    isDirty = true;
  }

  function turn(x, y) {
    change({azimuth: view.azimuth - x, elevation: view.elevation + y});
  }

  function pan(x, y) {
    const [right, up] = directions(data, view), scale = 2 * view.distance / (2.6 * canvas.clientHeight);
    change({centre: view.centre.map((c, k) => c + scale * (y * up[k] - x * right[k]))});
  }

  function toggle() {
    isPlaying = !isPlaying;
    isDirty = true;
  }

  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    canvas.setPointerCapture(event.pointerId);
    canvas.focus();
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener("pointermove", (event) => {
    const from = fingers.get(event.pointerId), to = [event.clientX, event.clientY];
    if (!from) return;
    const x = to[0] - from[0], y = to[1] - from[1];
    fingers.set(event.pointerId, to);
    if (fingers.size === 1 && !event.shiftKey && event.buttons < 2) turn(0.008 * x, 0.008 * y);
    else if (fingers.size === 1) pan(x, y);
    else {
      const [, other] = [...fingers].find(([id]) => id !== event.pointerId);
      const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      change({distance: view.distance * apart(from) / apart(to)});
      pan(x / 2, y / 2);
    }
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", () => change({...home}));
  canvas.addEventListener("wheel", (event) => {
    // a page that has this one in a frame scrolls until the picture was clicked
    if (isFramed && document.activeElement !== canvas) return;
    event.preventDefault();
    change({distance: view.distance * Math.exp(0.0015 * event.deltaY)});
  }, {passive: false});
  const keys = {
    ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0),
    ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1),
    "+": () => change({distance: view.distance / 1.2}), "-": () => change({distance: view.distance * 1.2}),
    " ": toggle,
  };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  play.addEventListener("click", toggle);
  slider.addEventListener("input", () => {
    time = first + Number(slider.value) * (last - first);
    isPlaying = false;
    isDirty = true;
  });
  find("inertia").addEventListener("change", () => { isDirty = true; });
  new ResizeObserver(show).observe(canvas);
  // #t=0.5&still shows that time and waits
  const asked = new URLSearchParams(window.location.hash.slice(1));
  if (asked.has("t")) time = Number(asked.get("t"));
  if (asked.has("still")) isPlaying = false;
  show();
  window.requestAnimationFrame(tick);
}

try {
  start(decoded(JSON.parse(document.getElementById("motion").textContent)));
} catch (error) {
  const line = document.createElement("p");
  line.textContent = "Nothing can be shown: " + error.message;
  document.body.prepend(line);
}
