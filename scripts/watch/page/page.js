"use strict";
// The page of `slcp watch`: draws what the engine sends, sends what the watcher does. It computes no physics.
const $ = id => document.getElementById(id);
const colours = { driven: "#56B4E9", free: "#E69F00", fixed: "#9A9A9A", ink: "#222", spring: "#0072B2", force: "#D55E00", pull: "#CC79A7", plan: "#009E73" };
let hello = null, picture = null, view = null, grabbed = false, drawn = 0, lost = false;
const history = { time: [], value: [] }, KEPT = 600;
const socket = new WebSocket(location.href.replace(/^http/, "ws").replace(/[^/]*$/, "") + "socket");
const send = message => { if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };

socket.onmessage = event => {
  const message = JSON.parse(event.data);
  if (message.hello !== undefined) { hello = message; build(); return; }
  send({ do: "got", value: message.frame });  // every picture received, drawn or not
  if (picture === null) requestAnimationFrame(draw);
  picture = message;
  remember();
};
socket.onclose = event => {
  lost = true;  // no picture that is still to be drawn writes over this
  $("clock").textContent = "not connected" + (event.reason ? ": " + event.reason : "");
};

function build() {
  $("name").textContent = hello.hello;
  document.title = hello.hello + " · slcp watch";
  chooser("policy", hello.policies);
  chooser("variant", hello.variants);
  for (const knob of hello.knobs) slider(knob);
  for (const name of hello.pushes) button($("pushes"), name, () => send({ do: "push", name }));
  const names = [...hello.states.map((n, i) => [n, p => p.state[i]]), ...hello.controls.map((n, i) => ["control " + n, p => p.control[i]]),
    ["normal impulse", p => p.impulse]];
  plotted = names.map(n => n[1]);
  names.forEach(([name], i) => $("plotted").add(new Option(name, i)));
  if (hello.replay) {
    $("record").remove();
    const bar = document.createElement("input");
    Object.assign(bar, { type: "range", min: 0, max: 1, step: 0.001, value: 0 });
    bar.oninput = () => send({ do: "seek", value: Number(bar.value) });
    $("knobs").append(bar);
  }
}
let plotted = [];
$("plotted").onchange = () => { history.time.length = history.value.length = 0; };
$("pause").onclick = () => send({ do: "pause", value: !picture.paused });
$("step").onclick = () => send({ do: "step" });
$("reset").onclick = () => send({ do: "reset" });
$("record").onclick = () => send({ do: "record", value: !picture.recording });

function button(place, text, act) {
  const made = document.createElement("button");
  made.textContent = text;
  made.onclick = act;
  place.append(made);
}
function chooser(what, names) {
  if (names.length < 2) return;
  const made = document.createElement("select");
  made.id = what;
  for (const name of names) made.add(new Option(name));
  made.onchange = () => send({ do: what, name: made.value });
  $("choices").append(made);
}
function slider(knob) {
  const label = document.createElement("label"), range = document.createElement("input"), shown = document.createElement("output");
  const there = v => knob.logarithmic ? Math.log(v / knob.low) / Math.log(knob.high / knob.low) : (v - knob.low) / (knob.high - knob.low);
  const back = s => knob.logarithmic ? knob.low * Math.pow(knob.high / knob.low, s) : knob.low + s * (knob.high - knob.low);
  Object.assign(range, { type: "range", min: 0, max: 1, step: 0.001, value: there(knob.value), id: "knob-" + knob.name });
  const show = v => { shown.textContent = v.toPrecision(3); };
  range.oninput = () => {
    const v = Math.min(knob.high, Math.max(knob.low, back(Number(range.value))));
    show(v);
    send({ do: "set", name: knob.name, value: v });
  };
  show(knob.value);
  label.append(knob.label, shown, range);
  $("knobs").append(label);
}

// World coordinates: all worlds side by side in one picture.
function fit(canvas) {
  const ratio = window.devicePixelRatio || 1, w = Math.round(canvas.clientWidth * ratio), h = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const [left, right, bottom, top] = picture.bounds, n = hello.worlds;
  const columns = Math.min(n, Math.ceil(Math.sqrt(n * (w / h) / ((right - left) / (top - bottom))))), rows = Math.ceil(n / columns);
  const scale = Math.min(w / columns / (right - left), h / rows / (top - bottom));
  const cell = i => [(i % columns + 0.5) * w / columns, (Math.floor(i / columns) + 0.5) * h / rows];
  view = { ratio, scale, columns, rows, w, h, middle: [(left + right) / 2, (bottom + top) / 2], cell };
  return canvas.getContext("2d");
}
const at = event => {  // where an event is: world's number and its coordinates
  const box = $("stage").getBoundingClientRect(), x = (event.clientX - box.left) * view.ratio, y = (event.clientY - box.top) * view.ratio;
  const column = Math.min(view.columns - 1, Math.floor(x / view.w * view.columns)), row = Math.min(view.rows - 1, Math.floor(y / view.h * view.rows));
  const world = grabbed === false ? Math.min(hello.worlds - 1, row * view.columns + column) : grabbed, [cx, cy] = view.cell(world);
  return { world, at: [view.middle[0] + (x - cx) / view.scale, view.middle[1] - (y - cy) / view.scale] };
};
$("stage").onpointerdown = event => {
  if (!view) return;
  $("stage").setPointerCapture(event.pointerId);
  const place = at(event);
  grabbed = place.world;
  send({ do: "grab", ...place });
};
$("stage").onpointermove = event => { if (grabbed !== false) send({ do: "drag", at: at(event).at }); };
const release = () => { if (grabbed !== false) { grabbed = false; send({ do: "release" }); } };
$("stage").onpointerup = release;
$("stage").onpointercancel = release;

function draw() {
  requestAnimationFrame(draw);
  if (!hello || lost || drawn === picture.frame) return;
  drawn = picture.frame;
  const c = fit($("stage"));
  c.setTransform(1, 0, 0, 1, 0, 0);
  c.clearRect(0, 0, view.w, view.h);
  for (let i = 0; i < hello.worlds; i++) world(c, i);
  words();
  plot();
}
function world(c, i) {
  const [cx, cy] = view.cell(i), s = view.scale;
  c.save();
  c.beginPath();
  c.rect(cx - view.w / view.columns / 2, cy - view.h / view.rows / 2, view.w / view.columns, view.h / view.rows);
  c.clip();
  c.setTransform(s, 0, 0, -s, cx - s * view.middle[0], cy + s * view.middle[1]);
  c.lineWidth = 1.5 * view.ratio / s;
  c.strokeStyle = colours.ink;
  hello.shapes.forEach((shape, k) => {
    const [x, y, a] = picture.poses[i][k];
    c.save();
    c.translate(x, y);
    c.rotate(a);
    c.fillStyle = shape.body < 0 ? colours.fixed : hello.driven.includes(shape.body) ? colours.driven : colours.free;
    outline(c, shape);
    c.fill();
    c.stroke();
    c.restore();
  });
  c.lineWidth = 2.5 * view.ratio / s;
  for (const link of picture.links) line(c, link[i]);
  c.strokeStyle = colours.spring;
  for (const spring of picture.springs[i] || []) line(c, spring);
  c.strokeStyle = colours.force;
  const most = Math.max(1e-9, ...picture.arrows[i].map(a => Math.hypot(a[2], a[3]))), long = 0.15 * (picture.bounds[3] - picture.bounds[2]);
  for (const [x, y, fx, fy] of picture.arrows[i]) line(c, [[x, y], [x + fx / most * long, y + fy / most * long]]);
  if (i === 0) {
    c.strokeStyle = colours.plan;
    c.lineWidth = 1.5 * view.ratio / s;
    for (const path of picture.plan) line(c, path);
  }
  const pull = picture.pull;
  if (pull && pull[0] === i) { c.strokeStyle = colours.pull; line(c, [[pull[1], pull[2]], [pull[3], pull[4]]]); }
  c.restore();
}
function outline(c, shape) {
  const [a, b, corner] = shape.radius;
  c.beginPath();
  if (shape.kind === "rope") return;  // a line is
  if (shape.kind === "halfplane") c.rect(-60, -60, 60, 120);
  else if (shape.kind === "capsule") { c.arc(b, 0, a, -Math.PI / 2, Math.PI / 2); c.arc(-b, 0, a, Math.PI / 2, 1.5 * Math.PI); c.closePath(); }
  else if (shape.kind === "rectangle") c.roundRect(-a, -b, 2 * a, 2 * b, corner);
  else if (shape.kind === "ring") { c.arc(0, 0, a, 0, 2 * Math.PI); c.arc(0, 0, 1.06 * a, 2 * Math.PI, 0, true); c.closePath(); }
  else { c.ellipse(0, 0, Math.max(a, 0.008), Math.max(b, 0.008), 0, 0, 2 * Math.PI); c.moveTo(-a, 0); c.lineTo(a, 0); }
}
function line(c, points) {
  c.beginPath();
  points.forEach(([x, y], i) => i ? c.lineTo(x, y) : c.moveTo(x, y));
  c.stroke();
}
function words() {
  const failed = picture.status.filter(s => s !== 0).length;
  $("clock").textContent = picture.time.toFixed(2) + " s" + (picture.pull ? ", pulled with " + picture.pull[5].toPrecision(3) + " N" : "") +
    (failed ? ", " + failed + " of " + hello.worlds + " worlds not solved" : "");
  $("said").textContent = picture.said;
  $("pause").textContent = picture.paused ? "go on" : "pause";
  $("record")?.classList.toggle("on", picture.recording);
  for (const what of ["policy", "variant"]) if ($(what) && document.activeElement !== $(what)) $(what).value = picture[what];
}
function remember() {
  const of = plotted[Number($("plotted").value)];
  if (!of) return;
  if (history.time.length && picture.time < history.time.at(-1)) history.time.length = history.value.length = 0;
  history.time.push(picture.time);
  history.value.push(of(picture));
  if (history.time.length > KEPT) { history.time.shift(); history.value.shift(); }
}
function plot() {
  const canvas = $("plot"), ratio = window.devicePixelRatio || 1, w = canvas.clientWidth * ratio, h = canvas.clientHeight * ratio;
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const c = canvas.getContext("2d");
  c.clearRect(0, 0, w, h);
  if (history.time.length < 2) return;
  const t0 = history.time[0], t1 = Math.max(history.time.at(-1), t0 + 1e-6), low = Math.min(...history.value), high = Math.max(...history.value);
  const room = Math.max(high - low, 1e-9), margin = 14 * ratio;
  c.strokeStyle = colours.spring;
  c.lineWidth = 1.5 * ratio;
  c.beginPath();
  history.time.forEach((t, i) => {
    const x = (t - t0) / (t1 - t0) * w, y = h - margin - (history.value[i] - low) / room * (h - 2 * margin);
    i ? c.lineTo(x, y) : c.moveTo(x, y);
  });
  c.stroke();
  c.fillStyle = colours.ink;
  c.font = 11 * ratio + "px system-ui";
  c.fillText(high.toPrecision(3), 2, 11 * ratio);
  c.fillText(low.toPrecision(3), 2, h - 3 * ratio);
}
