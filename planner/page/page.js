// The page: what `recorded_page.py` packed is unpacked, drawn, and played.
"use strict";

const $ = (id) => document.getElementById(id), data = JSON.parse($("data").textContent);
const dark = () => matchMedia("(prefers-color-scheme: dark)").matches;
const rgb = (color) => color.map((x) => x / 255), css = (color) => `rgb(${color.join()})`;
const ink = () => (dark() ? "#eee" : "#222"), ground = () => (dark() ? "#1b1c1e" : "#fff");

async function unpacked(text) { // base64 of gzip
  const bytes = Uint8Array.from(atob(text.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

function around(rows, at) { // the two rows around a place among them, and its share of the way from one to the other
  const i = Math.min(Math.max(Math.floor(at), 0), Math.max(rows.length - 2, 0));
  return [rows[i], rows[Math.min(i + 1, rows.length - 1)], Math.min(Math.max(at - i, 0), 1)];
}

function between(rows, at) { // numbers at a place along rows of them
  const [a, b, share] = around(rows, at);
  return a.map((x, k) => x + share * (b[k] - x));
}

function poseBetween(rows, at) { // the same of poses, position and quaternion, turned the shorter way
  const [a, b, share] = around(rows, at);
  const sign = a[3] * b[3] + a[4] * b[4] + a[5] * b[5] + a[6] * b[6] < 0 ? -1 : 1;
  const q = unit([3, 4, 5, 6].map((k) => a[k] + share * (sign * b[k] - a[k])));
  return [...between(rows, at).slice(0, 3), ...q];
}

function place(when, now) { // where a moment is among increasing ones
  if (now <= when[0]) return 0;
  if (now >= when[when.length - 1]) return when.length - 1;
  let low = 0, high = when.length - 1;
  while (high - low > 1) { const middle = (low + high) >> 1; if (when[middle] <= now) low = middle; else high = middle; }
  return low + (now - when[low]) / (when[high] - when[low]);
}

function haloed(context, text, x, y, color) { // text that is read on anything
  Object.assign(context, { lineWidth: 4, lineJoin: "round", strokeStyle: ground(), fillStyle: color });
  context.strokeText(text, x, y); context.fillText(text, x, y);
}

function curves(context, width, height, { title, unit, when, series, levels, now }) { // a small plot
  const left = 34, right = 6, top = 18, bottom = 16, values = series.flatMap((s) => s.values).concat(levels.map((l) => l.at), 0);
  const low = Math.min(...values), high = Math.max(...values) * 1.06 || 1, begin = when[0], end = when[when.length - 1];
  const x = (t) => left + (width - left - right) * (t - begin) / (end - begin), y = (v) => top + (height - top - bottom) * (high - v) / (high - low);
  context.clearRect(0, 0, width, height);
  context.font = "11px system-ui, sans-serif"; context.fillStyle = ink(); context.textBaseline = "middle";
  context.textAlign = "left"; context.fillText(title, left, 8);
  let right_ = width - right;
  for (const s of series.length > 4 ? [] : [...series].reverse()) { // the legend, in the title's line
    context.fillStyle = ink(); context.textAlign = "right"; context.fillText(s.name, right_, 8); right_ -= context.measureText(s.name).width + 12;
    context.fillStyle = s.color; context.fillRect(right_, 6, 9, 4); right_ -= 7;
  }
  const step = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].find((s) => (high - low) / s <= 4) || 1e4;
  context.textAlign = "right"; context.lineWidth = 1;
  for (let v = Math.ceil(low / step) * step; v <= high; v += step) {
    context.strokeStyle = dark() ? "#3a3a3a" : "#e5e5e5"; context.beginPath(); context.moveTo(left, y(v)); context.lineTo(width - right, y(v)); context.stroke();
    context.fillStyle = ink(); context.fillText(v, left - 4, y(v));
  }
  context.textAlign = "left"; context.fillText(`${+begin.toPrecision(3)}`, left, height - 7);
  context.textAlign = "right"; context.fillText(`${+end.toPrecision(3)}${unit}`, width - right, height - 7);
  const line = (points, color, dash) => {
    context.strokeStyle = color; context.setLineDash(dash); context.beginPath();
    points.forEach(([a, b], i) => (i ? context.lineTo(a, b) : context.moveTo(a, b))); context.stroke(); context.setLineDash([]);
  };
  for (const l of levels) line([[left, y(l.at)], [width - right, y(l.at)]], l.color, l.dash);
  context.lineWidth = 1.6;
  const drawn = series.map((s) => s.when.map((t, i) => [x(t), y(s.values[i])]));
  series.forEach((s, i) => line(drawn[i], s.color, s.dash));
  context.textAlign = "left";
  for (const l of levels) { // above or below its line, where the curves leave most room
    const wide = context.measureText(l.name).width, spots = [];
    for (const from of [0, 0.25, 0.5, 0.75, 1]) for (const off of [-7, 7]) {
      const a = left + 2 + from * (width - left - right - wide - 4), b = y(l.at) + off;
      const near = drawn.flat().filter(([u]) => u > a - 4 && u < a + wide + 4).map(([, v]) => Math.abs(v - b));
      if (b > top + 4 && b < height - bottom - 4) spots.push([Math.min(...near, 40), a, b]);
    }
    const best = spots.sort((one, two) => two[0] - one[0])[0];
    if (best) haloed(context, l.name, best[1], best[2], ink());
  }
  context.lineWidth = 1; line([[x(now), top], [x(now), height - bottom]], ink(), []);
  return (at) => begin + (end - begin) * Math.min(Math.max((at - left) / (width - left - right), 0), 1);
}

class Page {
  constructor(buffer) {
    this.stage = new Stage($("scene"));
    this.now = data.timeline.begin;
    this.meshes = data.meshes.map((m) => {
      const packed = new Uint16Array(buffer, m.points, 3 * m.corners), points = new Float32Array(packed.length);
      packed.forEach((v, i) => { points[i] = m.low[i % 3] + (m.high[i % 3] - m.low[i % 3]) * v / 65535; });
      const steps = new Int32Array(buffer, m.indices, 3 * m.triangles), indices = new Uint32Array(steps.length);
      let index = 0;
      steps.forEach((step, i) => { index += step; indices[i] = index; });
      return { ...m, ...this.stage.triangles(points, indices) };
    });
    this.compose();
    this.say();
    this.stage.look(...data.camera);
    this.stage.moved = () => this.draw();
    this.controls();
    new ResizeObserver(() => this.resize()).observe($("scene"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.grid(); this.draw(); });
    this.resize();
  }

  compose() { // what stands, ghosts, and the robots of the motions
    const { stage } = this;
    const still = (pose) => { const m = placed(pose); return () => m; };
    for (const o of data.obstacles) {
      const mesh = this.meshes[o.mesh];
      const here = o.poses ? () => placed(poseBetween(o.poses, place(data.when, this.now))) : still(o.pose);
      stage.solids.push({ mesh, place: here, color: rgb(mesh.color), alpha: o.alpha, group: o });
    }
    data.ghosts.forEach(({ robot, poses, color }, number) => {
      for (const i of robot) {
        const mesh = this.meshes[i];
        const visible = () => !data.motions.some((motion) => this.stands(motion, (joint) => poses[joint]));
        if (!mesh.joint) continue;
        const at = times(placed(poses[mesh.joint]), drawnIn(mesh, data.inset * (1 + number)));
        stage.solids.push({ mesh, place: () => at, color: rgb(color), alpha: 0.35, group: poses, visible });
      }
    });
    data.motions.forEach((motion, number) => {
      for (const i of data.robot) {
        const mesh = this.meshes[i];
        if (number && !mesh.joint) continue;
        const inner = drawnIn(mesh, number && data.inset * (data.ghosts.length + number));
        const along = () => times(placed(this.pose(motion, mesh.joint)), inner);
        const visible = () => !number || !this.stands(motion, (joint) => this.pose(data.motions[0], joint));
        stage.solids.push({ mesh, place: mesh.joint ? along : still(data.base), color: rgb(number ? motion.color : mesh.color), alpha: 1, visible });
      }
      const points = [], colors = [];
      for (let i = 1; i < motion.path.length; i++) {
        points.push(motion.path[i - 1], motion.path[i]); colors.push(rgb(motion.tints[i - 1]), rgb(motion.tints[i]));
      }
      stage.strips.push({ lines: stage.segments(points, colors), width: 3 });
    });
    this.ground = stage.segments([], []);
    stage.strips.unshift({ lines: this.ground, width: 0.6 });
    this.grid();
    this.slab();
    this.gap = stage.segments([], []);
    stage.strips.push({ lines: this.gap, width: 2.5 });
  }

  slab() { // the plane that keeps the closest pair apart, as thick as the distance proven
    if (!data.planes.length) return;
    const corners = [], faces = [];
    for (const axis of [0, 1, 2]) for (const side of [-0.5, 0.5]) { // each face with corners of its own
      for (const [a, b] of [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) {
        const corner = [0, 0, 0];
        corner[axis] = side; corner[(axis + 1) % 3] = a; corner[(axis + 2) % 3] = b;
        corners.push(...corner);
      }
      const i = corners.length / 3 - 4;
      faces.push(i, i + 1, i + 2, i, i + 2, i + 3);
    }
    const mesh = this.stage.triangles(new Float32Array(corners), new Uint32Array(faces));
    const place = () => {
      const { point, normal, thick } = this.plane(), [n, e] = [unit(normal), 0.3];
      const u = unit(cross(Math.abs(n[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], n)), v = cross(n, u);
      return new Float32Array([...u.map((x) => e * x), 0, ...v.map((x) => e * x), 0, ...n.map((x) => thick * x), 0, ...point, 1]);
    };
    const visible = () => $("plane").checked && this.plane() !== null;
    this.stage.solids.push({ mesh, place, color: rgb(data.plane), alpha: 0.45, group: data.planes, visible });
    $("planes").hidden = false;
    $("plane").addEventListener("change", () => this.draw());
  }

  plane() { // of now: between two moments of one plane on its way from one to the other
    const [a, b, share] = around(data.planes, place(data.when, this.now)), near = share < 0.5 ? a : b;
    if (!a || !b || a.of !== b.of) return near;
    const mixed = (key) => a[key].map((x, i) => x + share * (b[key][i] - x));
    return { ...near, point: mixed("point"), normal: mixed("normal"), thick: Math.min(a.thick, b.thick) };
  }

  pose(motion, joint) { return poseBetween(motion.poses[joint], place(motion.when, this.now)); }

  stands(motion, poses) { // whether its robot is where another one is, with which it would flicker
    const joints = new Set(data.robot.map((i) => this.meshes[i].joint).filter((joint) => joint));
    return [...joints].every((joint) => {
      const [a, b] = [this.pose(motion, joint), poses(joint)], [p, q] = [unit(a.slice(3)), unit(b.slice(3))];
      const turn = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3];
      return Math.hypot(...sub(a, b)) < 1e-3 && Math.abs(turn) > 1 - 1e-6;
    });
  }

  grid() { // in pieces: a line that runs from below the eye would be drawn in front of what hides it
    const [x, y, z] = data.floor, points = [], color = rgb(dark() ? [58, 59, 61] : [222, 222, 222]);
    for (let i = -15; i <= 15; i++) for (let j = -15; j < 15; j += 5) {
      const [s, from, to] = [i / 10, j / 10, (j + 5) / 10];
      points.push([x + s, y + from, z], [x + s, y + to, z], [x + from, y + s, z], [x + to, y + s, z]);
    }
    this.stage.replace(this.ground, points, points.map(() => color));
  }

  say() {
    document.querySelector("h1").textContent = data.title;
    for (const { name, verdict, certified, color } of data.motions) {
      const line = $("verdicts").appendChild(document.createElement("p"));
      line.style.color = certified ? "var(--good)" : "var(--bad)";
      line.textContent = `${certified ? "✓" : "✗"} ${data.motions.length > 1 ? `${name}: ` : ""}${verdict}`;
      if (data.motions.length > 1) line.style.borderLeft = `4px solid ${css(color)}`, line.style.paddingLeft = "6px";
    }
    $("notes").textContent = data.notes;
    data.stages.forEach((stage) => { // as long on the bar as in time
      const button = $("stages").appendChild(document.createElement("button"));
      button.textContent = stage.name;
      button.title = `${stage.name}, ${stage.begin.toFixed(2)} to ${stage.end.toFixed(2)} s: ${stage.words}`;
      button.className = stage.certified ? "" : "bad";
      button.style.flexGrow = stage.end - stage.begin;
      button.addEventListener("click", () => { this.stop(); this.go(stage.begin); });
    });
    this.bars = data.joints.map(({ name, low, high, unit, color }) => {
      const row = $("joints").insertRow(), cells = [row.insertCell(), row.insertCell(), row.insertCell()];
      const key = cells[0].appendChild(document.createElement("span"));
      key.className = "key"; key.style.background = css(color);
      cells[0].append(name);
      const bar = cells[2].appendChild(document.createElement("div"));
      if (low !== null) { bar.className = "range"; bar.title = `${low} to ${high} ${unit}`; bar.appendChild(document.createElement("i")); }
      return (value) => {
        cells[1].textContent = `${value.toFixed(3)} ${unit}`;
        if (low !== null) bar.firstChild.style.left = `${100 * (value - low) / (high - low)}%`;
      };
    });
  }

  controls() {
    const { begin, end, duration } = data.timeline, slider = $("time");
    Object.assign(slider, { min: begin, max: end, value: begin });
    slider.addEventListener("input", () => { this.stop(); this.go(+slider.value); });
    $("play").addEventListener("click", () => (this.playing ? this.stop() : this.play()));
    for (const plot of this.plots()) for (const kind of ["pointerdown", "pointermove"]) {
      plot.canvas.addEventListener(kind, (event) => { if (event.buttons) { this.stop(); this.go(this.seek(event.offsetX)); } });
    }
    document.addEventListener("keydown", (event) => {
      const step = (end - begin) / 100, to = { ArrowLeft: this.now - step, ArrowRight: this.now + step, Home: begin, End: end }[event.key];
      if (event.key === " " && event.target !== $("play")) $("play").click(), event.preventDefault();
      if (to !== undefined) this.stop(), this.go(to), event.preventDefault();
    });
    this.rate = (end - begin) / duration;
  }

  play() {
    if (this.now >= data.timeline.end) this.now = data.timeline.begin;
    this.playing = true; $("play").textContent = "Pause";
    let before = performance.now();
    const frame = (t) => {
      if (!this.playing) return;
      this.go(this.now + this.rate * (t - before) / 1000); before = t;
      if (this.now >= data.timeline.end) return this.stop();
      requestAnimationFrame(frame);
    };
    requestAnimationFrame((t) => { before = t; frame(t); });
  }

  stop() { this.playing = false; $("play").textContent = "Play"; }

  go(now) {
    this.now = Math.min(Math.max(now, data.timeline.begin), data.timeline.end);
    $("time").value = this.now;
    this.draw();
  }

  resize() {
    const scale = window.devicePixelRatio || 1;
    for (const canvas of [$("scene"), $("labels"), ...this.plots().map((plot) => plot.canvas)]) {
      canvas.width = Math.max(Math.round(canvas.clientWidth * scale), 1); canvas.height = Math.max(Math.round(canvas.clientHeight * scale), 1);
    }
    this.draw();
  }

  draw() { // once for each picture that the screen shows
    if (!this.waiting) this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.paint(); });
  }

  stageNow() { // the one that begins, where two meet
    return data.stages.findLastIndex((stage) => stage.begin <= this.now + 1e-9);
  }

  nearest() { // of the moments at which distances were computed
    return data.closest[Math.round(place(data.when, this.now))];
  }

  paint() {
    const near = this.nearest(), pairs = near.filter((x) => x);
    this.stage.replace(this.gap, pairs.flatMap((x) => x.points), pairs.flatMap((x) => [rgb(x.color), rgb(x.color)]));
    this.stage.draw();
    const context = $("labels").getContext("2d"), scale = window.devicePixelRatio || 1;
    context.setTransform(scale, 0, 0, scale, 0, 0);
    this.label(context, $("labels").width / scale, $("labels").height / scale, near);
    $("clock").textContent = this.clock();
    $("now").innerText = this.words(near).join("\n");
    [...$("stages").children].forEach((button, i) => button.classList.toggle("now", i === this.stageNow()));
    const motion = data.motions[0], values = between(motion.joints, place(motion.when, this.now));
    this.bars.forEach((show, i) => show(values[i]));
    for (const { canvas, title, series, levels } of this.plots()) {
      const small = canvas.getContext("2d"), coloured = levels.map((l) => ({ ...l, color: css(l.color) }));
      small.setTransform(scale, 0, 0, scale, 0, 0);
      this.seek = curves(small, canvas.width / scale, canvas.height / scale, {
        title, unit: data.timeline.timed ? " s" : "", when: [data.timeline.begin, data.timeline.end], series, levels: coloured, now: this.now });
    }
    const plane = data.planes.length ? this.plane() : null;
    $("plane-words").textContent = plane ? `${plane.words}: ${plane.of}` : "no plane here";
  }

  clock() { return data.timeline.timed ? `${this.now.toFixed(2)} s` : `path ${this.now.toFixed(2)}`; }

  words(near) {
    const lines = ["to obstacles", "between links"].map((what, i) => near[i] && `${what} ${near[i].words} (${near[i].pair})`);
    const stage = data.stages[this.stageNow()], about = stage ? [`stage ${stage.name}: ${stage.words}`] : [];
    return [...about, "clearance at this moment:", ...lines.filter((x) => x)];
  }

  label(context, width, height, near) {
    context.clearRect(0, 0, width, height);
    context.font = "12px system-ui, sans-serif"; context.textAlign = "center"; context.textBaseline = "middle";
    const shown = near[0] || near[1], both = [...data.labels];
    if (shown) both.push({ text: shown.words, at: shown.points[0].map((x, i) => (x + shown.points[1][i]) / 2), color: null, above: 22 });
    for (const { text, at, color, above } of both) {
      const spot = this.stage.onScreen(at);
      if (!spot) continue;
      haloed(context, text, spot[0] * width, spot[1] * height - above, color ? css(dark() ? color.map((x) => (x + 255) / 2) : color.map((x) => 0.8 * x)) : ink());
    }
  }

  plots() { // clearance of all motions; joints, and shares of limits, of the first one
    if (this.drawn) return this.drawn;
    const [first] = data.motions, one = data.motions.length === 1;
    const clearance = data.motions.map((m) => ({ name: one ? "to obstacles" : m.name, when: m.when, values: m.clearance, color: css(m.color), dash: [] }));
    if (one) clearance.push({ name: "between links", when: first.when, values: first.own, color: css(data.between), dash: [5, 3] });
    const joints = data.joints.map(({ name, color }, i) => ({ name, when: first.when, values: first.joints.map((q) => q[i]), color: css(color), dash: [] }));
    const shares = first.shares.map((s) => ({ name: s.quantity, when: s.when, values: s.values, color: css(s.color), dash: [] }));
    const all = [
      { canvas: $("clearance"), title: "clearance [mm]", series: clearance.filter((s) => s.values.length), levels: data.levels },
      { canvas: $("curves"), title: "joints [rad or m]", series: joints, levels: [] },
      { canvas: $("shares"), title: "of limits [%]", series: shares, levels: [{ at: 100, name: "", color: data.bad, dash: [2, 3] }] }];
    for (const { canvas, series } of all) canvas.hidden = !series.length;
    this.drawn = all.filter(({ series }) => series.length);
    return this.drawn;
  }
}

unpacked($("meshes").textContent).then((buffer) => { window.page = new Page(buffer); window.page.paint(); }).catch((error) => {
  $("verdicts").textContent = `This page cannot be drawn: ${error.message}`;
});
