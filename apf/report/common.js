// What the pages of one person and of several share: the state, the player, the video.
"use strict";
const page = JSON.parse(document.getElementById("content").textContent);
const byId = (id) => document.getElementById(id);
const config = { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["toImage", "lasso2d", "select2d"] };


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
