// The page of one person or of several: the player, the video, and the charts that there is content for.
"use strict";
const page = JSON.parse(document.getElementById("content").textContent);
const byId = (id) => document.getElementById(id);
const config = { displayModeBar: false, responsive: true };

function bytes(text) {
  const raw = atob(text), out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out;
}

function element(kind, text, parent) {
  const made = document.createElement(kind);
  made.textContent = text;
  parent.append(made);
  return made;
}

/** A joint's name as people say it. */
const plain = (name) => name.replace(/^l_/, "left ").replace(/^r_/, "right ").replaceAll("_", " ");

// The state: one row of the track is shown -------------------------------------------------------

const nRows = page.frames.length;
let row = 0;
const listeners = [];

function show(wanted) {
  row = Math.max(0, Math.min(nRows - 1, Math.round(wanted)));
  for (const listener of listeners) listener(row);
}

// The room of the player; `traces(at)` of each page draws into it ---------------------------------

const scene = page.scene;

const axis = (k, name) => ({ range: [scene.low[k], scene.high[k]], title: { text: name },
  backgroundcolor: "#eef1f5", showbackground: k === 2, gridcolor: "#d9dee5", zeroline: false });
const extent = [0, 1, 2].map((k) => scene.high[k] - scene.low[k]);
const largest = Math.max(...extent);
const room = {
  margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, uirevision: "kept",
  scene: { xaxis: axis(0, "x, m"), yaxis: axis(1, "y, m"), zaxis: axis(2, "z, m"),
    aspectmode: "manual", dragmode: "orbit",
    aspectratio: { x: extent[0] / largest, y: extent[1] / largest, z: extent[2] / largest },
    camera: { eye: { x: 1.25, y: 1.25, z: 0.6 }, center: { x: 0, y: 0, z: -0.1 } } },
};

// Without WebGL the same traces are painted on a plane; a drag turns it.

const hasWebGL = Boolean(document.createElement("canvas").getContext("webgl"));
const turned = [0.8, 0.35]; // azimuth and elevation of the viewer, rad
const list = (values, n) => (Array.isArray(values) ? values : new Array(n).fill(values));

function paint(shown) {
  const canvas = byId("player").querySelector("canvas") || addCanvas();
  const [wide, high] = [canvas.width = canvas.clientWidth, canvas.height = canvas.clientHeight];
  const pen = canvas.getContext("2d"), scale = (0.9 * Math.min(wide, high)) / Math.hypot(...extent);
  const [ca, sa] = [Math.cos(turned[0]), Math.sin(turned[0])];
  const [ce, se] = [Math.cos(turned[1]), Math.sin(turned[1])];
  const middle = [0, 1, 2].map((k) => (scene.low[k] + scene.high[k]) / 2);
  const place = (x, y, z) => {
    const [a, b, c] = [x - middle[0], y - middle[1], z - middle[2]];
    return [wide / 2 + scale * (ca * b - sa * a), high / 2 - scale * (ce * c - se * (ca * a + sa * b)),
      ce * (ca * a + sa * b) + se * c];
  };
  const line = (from, to, colour, width) => {
    pen.strokeStyle = colour; pen.lineWidth = width; pen.lineCap = "round";
    pen.beginPath(); pen.moveTo(from[0], from[1]); pen.lineTo(to[0], to[1]); pen.stroke();
  };
  const [x0, y0, z0] = scene.low, [x1, y1] = scene.high;
  for (let x = Math.ceil(x0); x <= x1; x++) line(place(x, y0, z0), place(x, y1, z0), "#d9dee5", 1);
  for (let y = Math.ceil(y0); y <= y1; y++) line(place(x0, y, z0), place(x1, y, z0), "#d9dee5", 1);
  for (const one of [...shown].reverse()) { // voxels are the last trace, and lie behind the skeleton
    const places = one.x.map((x, i) => (x === null ? null : place(x, one.y[i], one.z[i])));
    if (one.mode === "lines") {
      const colours = list(one.line.color, places.length);
      for (let i = 1; i < places.length; i++) {
        if (places[i - 1] && places[i]) line(places[i - 1], places[i], colours[i], one.line.width / 2);
      }
    } else {
      const colours = list(one.marker.color, places.length), size = one.marker.size * 1.5;
      pen.globalAlpha = one.marker.opacity ?? 1;
      for (const i of [...places.keys()].sort((a, b) => places[a][2] - places[b][2])) {
        pen.fillStyle = colours[i];
        pen.fillRect(places[i][0] - size / 2, places[i][1] - size / 2, size, size);
      }
      pen.globalAlpha = 1;
    }
  }
}

function addCanvas() {
  const canvas = element("canvas", "", byId("player"));
  canvas.style.cssText = "width:100%;height:100%;touch-action:none";
  canvas.onpointermove = (event) => {
    if (!event.buttons) return;
    turned[0] -= event.movementX / 150;
    turned[1] = Math.max(-1.5, Math.min(1.5, turned[1] + event.movementY / 150));
    draw(row);
  };
  return canvas;
}

let drawing = false, waiting = null;

/** Draw the newest row; rows that come while one is drawn wait, the last of them only. */
async function draw(at) {
  if (drawing) { waiting = at; return; }
  drawing = true;
  if (hasWebGL) await Plotly.react("player", traces(at), room, config); else paint(traces(at));
  drawing = false;
  byId("player").dataset.row = at;
  if (waiting !== null) { const next = waiting; waiting = null; draw(next); }
}

// The video --------------------------------------------------------------------------------------

const film = document.querySelector("video");
const steps = page.frames.slice(1).map((frame, i) => frame - page.frames[i]).sort((a, b) => a - b);
const rate = Math.max(1, page.fps / Math.max(1, steps.length ? steps[steps.length >> 1] : 1));
if (page.video) {
  film.src = URL.createObjectURL(new Blob([bytes(page.video)], { type: "video/mp4" }));
  film.onloadedmetadata = () => {  // pictures in one row are seen in the whole width
    if (film.videoWidth <= 2 * film.videoHeight) return;
    document.querySelector(".views").classList.add("alone");
    dispatchEvent(new Event("resize"));  // for the 3-D view
  };
  listeners.push((at) => { if (film.paused) film.currentTime = (at + 0.5) / rate; });
} else {
  byId("film").remove();
  document.querySelector(".views").classList.add("alone");
}

// Playing ----------------------------------------------------------------------------------------

let playing = false, began = 0;
const speed = () => Number(byId("speed").value);

function play(on) {
  playing = on;
  byId("play").textContent = on ? "pause" : "play";
  if (on && row >= nRows - 1) show(0);
  began = performance.now() - (1000 * row) / (rate * speed());
  if (page.video) {
    film.playbackRate = speed();
    if (on) { film.currentTime = (row + 0.5) / rate; film.play(); } else film.pause();
  }
  if (on) requestAnimationFrame(tick);
}

function tick(now) {
  if (!playing) return;
  const clock = page.video ? film.currentTime * rate : ((now - began) / 1000) * rate * speed();
  const at = Math.floor(clock);
  if (at >= nRows || (page.video && film.ended)) { play(false); show(nRows - 1); return; }
  if (at !== row) show(at);
  requestAnimationFrame(tick);
}

byId("play").onclick = () => play(!playing);
byId("speed").onchange = () => { if (playing) play(true); };
byId("slider").max = nRows - 1;
byId("slider").oninput = (event) => { play(false); show(Number(event.target.value)); };
document.addEventListener("keydown", (event) => {
  if (event.target.matches("input, select, button")) return;
  if (event.key === " ") { event.preventDefault(); play(!playing); }
  if (event.key === "ArrowRight") { play(false); show(row + 1); }
  if (event.key === "ArrowLeft") { play(false); show(row - 1); }
});

const COLOURS = ["#2f6fb5", "#d9661f", "#3d9b52", "#9355b0", "#c0392b", "#7a5c3e", "#d36ba6", "#5d6d7e"];
/** Of the body's sides. */
const SIDES = { left: COLOURS[0], right: COLOURS[1], middle: COLOURS[2] };
const DASHES = ["solid", "dash", "dot", "dashdot"];
function table(id, rows) {
  for (const [name, value] of rows) {
    if (value === null || value === undefined || value === "") continue;
    const row = element("tr", "", byId(id));
    element("td", name, row);
    element("td", value, row);
  }
}

/** The number, among the frames that were judged, of the last one up to a row. */
function judged(wanted) {
  let low = 0, high = page.rows.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (page.rows[middle] <= wanted) low = middle; else high = middle - 1;
  }
  return low;
}

// The bodies ---------------------------------------------------------------------------------------

const { people } = page, alone = people.length === 1;
for (const person of people) person.joints = new Float32Array(bytes(person.joints).buffer);

/** Bones and joints of a person, as `Figure` of drawing.py colours them; nothing where unseen. */
function skeleton(person, at) {
  const n = person.joint_names.length;
  const point = (k) => person.joints.subarray(3 * (n * at + k), 3 * (n * at + k) + 3);
  if (!person.shown[at]) return [];
  const x = [], y = [], z = [], color = [];
  person.edges.forEach(([a, b], number) => {
    const shade = person.lost_at[at] ? scene.lost_colour : person.edge_colours[number];
    for (const [px, py, pz] of [point(a), point(b)]) { x.push(px); y.push(py); z.push(pz); color.push(shade); }
    x.push(null); y.push(null); z.push(null); color.push(shade);
  });
  const points = person.joint_names.map((_, k) => point(k));
  const [jx, jy, jz] = [0, 1, 2].map((k) => points.map((one) => one[k]));
  return [{ type: "scatter3d", mode: "lines", x, y, z, hoverinfo: "skip", line: { width: 9, color } },
    { type: "scatter3d", mode: "markers", x: jx, y: jy, z: jz,
      text: person.joint_names.map((name) => (alone ? "" : `${person.name}, `) + plain(name)),
      hovertemplate: "%{text}<br>%{x:.3f}, %{y:.3f}, %{z:.3f} m<extra></extra>",
      marker: { size: 4, color: "#11151a" } }];
}

let cells, shades;
const first = [0];
if (page.voxels) {
  const packed = bytes(page.voxels.cells);
  cells = page.voxels.bytes === 1 ? packed : new Uint16Array(packed.buffer);
  shades = bytes(page.voxels.colours);
  for (const count of page.voxels.counts) first.push(first[first.length - 1] + count);
} else byId("voxels-box").remove();

function cloud(at) {
  const number = judged(at), x = [], y = [], z = [], color = [];
  const { origin, size } = page.voxels;
  for (let i = 3 * first[number]; i < 3 * first[number + 1]; i += 3) {
    x.push(origin[0] + size * cells[i]);
    y.push(origin[1] + size * cells[i + 1]);
    z.push(origin[2] + size * cells[i + 2]);
    color.push(`rgb(${shades[i]},${shades[i + 1]},${shades[i + 2]})`);
  }
  // Thin enough that the skeleton within is seen.
  return { type: "scatter3d", mode: "markers", x, y, z, hoverinfo: "skip",
    marker: { size: 2.2, color, opacity: byId("show-skeleton").checked ? 0.22 : 0.9 } };
}

function traces(at) {
  const shown = byId("show-skeleton").checked
    ? people.filter((person) => !person.box || person.box.checked).flatMap((person) => skeleton(person, at)) : [];
  if (page.voxels && byId("show-voxels").checked) shown.push(cloud(at));
  return shown;
}

function describe(at) {
  if (!alone) return `, ${page.counts[at]} ${page.counts[at] === 1 ? "person" : "people"}`;
  const confidence = page.confidence?.frames[at] ?? null;
  return people[0].lost_at[at] ? ": LOST" : confidence === null ? "" : `, confidence ${confidence.toFixed(2)}`;
}

listeners.push((at) => {
  const frame = byId("frame");
  byId("slider").value = at;
  frame.textContent = `frame ${page.frames[at]}, ${(page.frames[at] / page.fps).toFixed(2)} s${describe(at)}`;
  frame.classList.toggle("lost", alone && Boolean(people[0].lost_at[at]));
});

// The charts -------------------------------------------------------------------------------------

const judgedFrames = page.rows?.map((at) => page.frames[at]);

/** Call `show` with a part of the content, or remove the elements that show it if there is none. */
function section(content, ids, show) {
  if (content) show(content); else for (const id of ids) byId(id).remove();
}

function layout(y, more) {
  const wide = window.innerWidth > 600;
  return { margin: { l: wide ? 90 : 72, r: wide ? 60 : 8, t: 8, b: 36 }, hovermode: "x unified",
    xaxis: { title: { text: "frame" }, range: [page.frames[0], page.frames[nRows - 1]] },
    yaxis: { title: { text: y } }, legend: { orientation: "h", y: 1.02, yanchor: "bottom" }, ...more };
}

/** Draw a chart over the frames with a line at the frame shown; a click shows that frame. */
function chart(id, traces, look) {
  const box = byId(id);
  Plotly.react(box, traces, look, config);
  if (box.querySelector(".now")) return;
  const line = element("div", "", box);
  line.className = "now";
  const place = () => {
    const axis = box._fullLayout.xaxis, x = axis.l2p(page.frames[row]);
    line.style.display = x >= 0 && x <= axis._length ? "" : "none";
    line.style.left = `${axis._offset + x}px`;
  };
  listeners.push(place);
  box.on("plotly_afterplot", place);
  box.on("plotly_click", (event) => {
    const frame = Number(event.points[0].x);
    play(false);
    show(page.frames.findIndex((other) => other >= frame));
  });
}

function curve(x, y, name, number, more) {
  return { x, y, name, mode: "lines", line: { color: COLOURS[number % COLOURS.length], width: 1.6 },
    hovertemplate: "%{y}", ...more };
}

section(page.confidence, ["confidence-section"], ({ parts, values, frames, scale, doubtful }) => {
  chart("parts", [{ type: "heatmap", x: judgedFrames, y: parts, z: values, zmin: 0, zmax: 1,
    colorscale: scale, colorbar: { thickness: 12 }, showscale: window.innerWidth > 600,
    hovertemplate: "frame %{x}, %{y}: %{z:.2f}<extra></extra>" }], layout("", { hovermode: "closest" }));
  chart("confidence", [curve(page.frames, frames, "whole body", 0)],
    layout("confidence", { yaxis: { title: { text: "confidence" }, range: [0, 1.02] } }));
  byId("confidence-note").textContent =
    "Of limbs, the probability that they are right; of head and trunk, 0 to 1, how much of the worst " +
    "part lies in the silhouettes, and how firmly its end is known. " +
    `Below ${doubtful}, look at it. Below: how well the voxels are explained, as the ` +
    "tracker judged while it tracked.";
});

section(page.agreement, ["agreement-section"], ({ cameras, body, voxels: hulls }) =>
  chart("agreement", cameras.flatMap((camera, i) => [
    curve(judgedFrames, body[i], camera, i, { legendgroup: camera }),
    curve(judgedFrames, hulls[i], `${camera}, voxels`, i, { legendgroup: camera, showlegend: false,
      line: { color: COLOURS[i % COLOURS.length], width: 1, dash: "dot" } }),
  ]), layout("IoU", { yaxis: { title: { text: "IoU" }, range: [0, 1.02] } })));

/** The area in which a curve's values may lie, run by run of what is known. */
function area(one, color) {
  let x = [], y = [];
  for (let at = 0, end; at < nRows; at = end + 1) {
    for (end = at; end < nRows && one.band[end] !== null;) end++;
    const rows = Array.from({ length: end - at }, (_, i) => at + i), back = [...rows].reverse();
    x = x.concat([...rows, ...back].map((i) => page.frames[i]), null);
    y = y.concat(rows.map((i) => one.values[i] + one.band[i]), back.map((i) => one.values[i] - one.band[i]), null);
  }
  return { x, y, fill: "toself", fillcolor: `${color}22`, mode: "none", hoverinfo: "skip", showlegend: false };
}

/** Left and right have the body's colours; each angle has its dash. */
function angles(number, curves) {
  const names = [...new Set(curves.map((one) => one.name))];
  chart(`angles${number}`, curves.map((one) => area(one, SIDES[one.side])).concat(curves.map((one) =>
    curve(page.frames, one.values, one.side === "middle" ? one.name : `${one.side} ${one.name}`, 0,
      { line: { color: SIDES[one.side], width: 1.6, dash: DASHES[names.indexOf(one.name)] } }))),
    layout("degrees", { showlegend: true }));
}
section(Object.keys(page.angles ?? {}).length && page.angles, ["angles-section"], (groups) => {
  const names = Object.keys(groups);
  document.querySelectorAll("#angles-section select").forEach((choice, number) => {
    for (const name of names) element("option", name, choice);
    choice.onchange = () => angles(number, groups[choice.value]);
    choice.selectedIndex = Math.min(number, names.length - 1);
    choice.onchange();
  });
});

// Several people ---------------------------------------------------------------------------------

section(!alone && people, ["people-section", "presence-section"], () => {
  for (const person of people) {
    const line = element("tr", "", byId("people"));
    person.box = element("input", "", element("td", "", line));
    Object.assign(person.box, { type: "checkbox", checked: true, ariaLabel: person.name, onchange: () => draw(row) });
    const link = element(person.page ? "a" : "span", person.name, element("td", "", line));
    if (person.page) link.href = person.page;
    link.style.cssText = `color: ${person.colour}; font-weight: 600`;
    for (const text of [person.verdict, person.seen, person.lost, person.height]) element("td", text, line);
  }
  chart("presence", people.map((person, number) => ({
    x: page.frames, y: person.shown.map((on) => (on ? number + 1 : null)), name: person.name,
    mode: "lines", line: { width: 14, color: person.colour }, hovertemplate: "frame %{x}",
  })), layout("", { showlegend: false, hovermode: "closest",
    yaxis: { tickvals: people.map((_, k) => k + 1), ticktext: people.map((p) => p.name),
      range: [people.length + 0.6, 0.4], zeroline: false } }));
});

// Texts ------------------------------------------------------------------------------------------

byId("name").textContent = page.name;
for (const line of page.lines) {
  const item = element("li", `${line} `, byId("lines"));
  const [, rows] = Object.entries(page.look_at ?? {}).find(([what]) => line.startsWith(`look at ${what}:`)) ?? [];
  if (rows) element("a", "show", item).onclick = () => { play(false); show(rows[0]); };
}
section(page.summary, ["verdict", "warnings", "tables-section", "settings-section"], (summary) => {
  const { body } = summary;
  byId("verdict").textContent = byId("verdict").className = page.verdict;
  for (const warning of summary.warnings) element("p", warning, byId("warnings"));
  table("body", [["model", body.name], ["height", body.height_m && `${body.height_m.toFixed(2)} m`],
    ...Object.entries(body.lengths_m).map(([name, length]) => [name, `${length.toFixed(3)} m`])]);
  table("joints", Object.entries(summary.quality.joint_deviation_mm)
    .map(([name, value]) => [plain(name), value === null ? null : `± ${value.toFixed(0)} mm`]));
  table("run", [["sequence", summary.sequence.folder], ["cameras", summary.sequence.cameras.join(", ")],
    ["left out", Object.keys(summary.sequence.left_out).join(", ")],
    ["frames", `${nRows}${summary.complete ? "" : ` of ${summary.frames_wanted}, interrupted`}`],
    ["frames per second", summary.sequence.fps], ["took", summary.seconds && `${Math.round(summary.seconds)} s`],
    ["files", summary.files.join(", ")]]);
  table("versions", [["device", summary.device.name], ...Object.entries(summary.versions)]);
  byId("settings").textContent = summary.settings;
});

// Begin ------------------------------------------------------------------------------------------

listeners.push(draw);
for (const id of ["show-voxels", "show-skeleton"]) if (byId(id)) byId(id).onchange = () => draw(row);
show(0);
document.body.dataset.ready = "yes";
