const COLOURS = ["#2f6fb5", "#d9661f", "#3d9b52", "#9355b0", "#c0392b", "#7a5c3e", "#d36ba6", "#5d6d7e"];
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

// The player -------------------------------------------------------------------------------------

const joints = new Float32Array(bytes(scene.joints).buffer);
const nJoints = scene.joint_names.length;

function joint(at, number) {
  const start = 3 * (at * nJoints + number);
  return joints.subarray(start, start + 3);
}

function skeleton(at) {
  const x = [], y = [], z = [], color = [];
  scene.edges.forEach(([a, b], number) => {
    const shade = page.lost[at] ? scene.lost_colour : scene.edge_colours[number];
    for (const point of [joint(at, a), joint(at, b)]) {
      x.push(point[0]); y.push(point[1]); z.push(point[2]); color.push(shade);
    }
    x.push(null); y.push(null); z.push(null); color.push(shade);
  });
  return { type: "scatter3d", mode: "lines", x, y, z, hoverinfo: "skip", line: { width: 9, color } };
}

function ends(at) {
  const points = scene.joint_names.map((_, number) => joint(at, number));
  const [x, y, z] = [0, 1, 2].map((k) => points.map((point) => point[k]));
  return { type: "scatter3d", mode: "markers", x, y, z, text: scene.joint_names.map(plain),
    hovertemplate: "%{text}<br>%{x:.3f}, %{y:.3f}, %{z:.3f} m<extra></extra>",
    marker: { size: 4, color: "#11151a" } };
}

let cells, shades;
const first = [0];
if (scene.voxels) {
  const packed = bytes(scene.voxels.cells);
  cells = scene.voxels.bytes === 1 ? packed : new Uint16Array(packed.buffer);
  shades = bytes(scene.voxels.colours);
  for (const count of scene.voxels.counts) first.push(first[first.length - 1] + count);
} else byId("show-voxels").parentElement.remove();

function cloud(at) {
  const number = judged(at), x = [], y = [], z = [], color = [];
  const { origin, size } = scene.voxels;
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
  const shown = [];
  if (byId("show-skeleton").checked) shown.push(skeleton(at), ends(at));
  if (scene.voxels && byId("show-voxels").checked) shown.push(cloud(at));
  return shown;
}

listeners.push((at) => {
  byId("slider").value = at;
  const frame = byId("frame");
  const confidence = page.confidence.frames[at];
  frame.textContent = `frame ${page.frames[at]}, ${(page.frames[at] / page.fps).toFixed(2)} s` +
    (page.lost[at] ? ": LOST" : confidence === null ? "" : `, confidence ${confidence.toFixed(2)}`);
  frame.classList.toggle("lost", Boolean(page.lost[at]));
});

// The charts -------------------------------------------------------------------------------------

const judgedFrames = page.rows.map((at) => page.frames[at]);

function layout(y, more) {
  return { margin: { l: 110, r: 70, t: 8, b: 36 }, hovermode: "x unified",
    xaxis: { title: { text: "frame" }, range: [page.frames[0], page.frames[nRows - 1]] },
    yaxis: { title: { text: y } }, legend: { orientation: "h", y: 1.12 }, ...more };
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

chart("parts", [{ type: "heatmap", x: judgedFrames, y: page.confidence.parts,
  z: page.confidence.values, zmin: 0, zmax: 1, colorscale: [[0, "#8e1b1b"], [0.5, "#e08a3c"],
    [page.doubtful_below, "#f1dc8a"], [1, "#3d9b6a"]], colorbar: { thickness: 12 },
  hovertemplate: "frame %{x}, %{y}: %{z:.2f}<extra></extra>" }],
layout("", { hovermode: "closest" }));
chart("confidence", [curve(page.frames, page.confidence.frames, "whole body", 0)],
  layout("confidence", { yaxis: { title: { text: "confidence" }, range: [0, 1.02] } }));
byId("confidence-note").textContent =
  "Of limbs, the probability that they are right; of head and trunk, 0 to 1, how much of the worst " +
  "part lies in the silhouettes, and how firmly its end is known. " +
  `Below ${page.doubtful_below}, look at it. Below: how well the voxels are explained, as the ` +
  "tracker judged while it tracked.";

if (page.agreement) {
  const { cameras, body, voxels: hulls } = page.agreement;
  chart("agreement", cameras.flatMap((camera, i) => [
    curve(judgedFrames, body[i], camera, i, { legendgroup: camera }),
    curve(judgedFrames, hulls[i], `${camera}, voxels`, i, { legendgroup: camera, showlegend: false,
      line: { color: COLOURS[i % COLOURS.length], width: 1, dash: "dot" } }),
  ]), layout("IoU", { yaxis: { title: { text: "IoU" }, range: [0, 1.02] } }));
} else byId("agreement-section").remove();

/** Left and right of an angle share a colour; left is dashed. */
function angles() {
  const group = page.angles[byId("joint").value];
  const names = [...new Set(group.curves.map((one) => one.name))];
  chart("angles", group.curves.map((one) => curve(page.frames, one.values,
    one.side === "middle" ? one.name : `${one.side} ${one.name}`, names.indexOf(one.name),
    one.side === "left" ? { line: { color: COLOURS[names.indexOf(one.name) % COLOURS.length],
      width: 1.6, dash: "dash" } } : {})), layout("degrees", { showlegend: true }));
}
page.angles.forEach((group, i) => { element("option", group.name, byId("joint")).value = i; });
byId("joint").onchange = angles;
angles();

// Texts ------------------------------------------------------------------------------------------

const { summary } = page;
byId("name").textContent = page.name;
byId("verdict").textContent = page.verdict;
byId("verdict").className = page.verdict;
element("li", page.lines[0], byId("lines"));
for (const [what, rows] of Object.entries(page.look_at)) {
  const item = element("li", page.lines.find((line) => line.startsWith(`look at ${what}:`)) + " ", byId("lines"));
  element("a", "show", item).onclick = () => { play(false); show(rows[0]); };
}
for (const warning of summary.warnings) element("p", warning, byId("warnings"));
const { body } = summary;
table("body", [["model", body.name], ["height", body.height_m && `${body.height_m.toFixed(2)} m`],
  ...Object.entries(body.lengths_m).map(([name, length]) => [name, `${length.toFixed(3)} m`])]);
table("joints", Object.entries(summary.quality.joint_deviation_mm)
  .map(([name, value]) => [plain(name), value === null ? null : `± ${value.toFixed(0)} mm`]));
table("run", [["sequence", summary.sequence.folder], ["cameras", summary.sequence.cameras.join(", ")],
  ["left out", Object.keys(summary.sequence.left_out).join(", ")],
  ["frames", `${nRows}${summary.complete ? "" : ` of ${summary.frames_wanted}, interrupted`}`],
  ["frames per second", summary.sequence.fps], ["took", summary.seconds && `${summary.seconds} s`],
  ["files", summary.files.join(", ")]]);
table("versions", [["device", summary.device.name], ...Object.entries(summary.versions)]);
byId("settings").textContent = page.settings;

// Begin ------------------------------------------------------------------------------------------

listeners.push(draw);
for (const id of ["show-voxels", "show-skeleton"]) if (byId(id)) byId(id).onchange = () => draw(row);
show(0);
document.body.dataset.ready = "yes";
