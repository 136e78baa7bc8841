// The list of people -----------------------------------------------------------------------------

byId("name").textContent = page.name;
for (const line of page.lines) element("li", line, byId("lines"));
const switches = page.people.map((person) => {
  person.joints = new Float32Array(bytes(person.joints).buffer);
  const line = element("tr", "", byId("people"));
  const box = element("input", "", element("td", "", line));
  box.type = "checkbox";
  box.checked = true;
  box.onchange = () => draw(row);
  box.ariaLabel = person.name;
  const name = element("td", "", line);
  const link = element(person.page ? "a" : "span", person.name, name);
  if (person.page) link.href = person.page;
  link.style.color = person.colour;
  link.style.fontWeight = 600;
  for (const text of [person.verdict, person.seen, person.lost, person.height]) element("td", text, line);
  return box;
});

// The player -------------------------------------------------------------------------------------

function traces(at) {
  const shown = [];
  page.people.forEach((person, number) => {
    const n = person.joint_names.length, start = 3 * n * at;
    const point = (k) => person.joints.subarray(start + 3 * k, start + 3 * k + 3);
    if (!switches[number].checked || Number.isNaN(person.joints[start])) return;
    const x = [], y = [], z = [];
    for (const [a, b] of person.edges) {
      for (const [px, py, pz] of [point(a), point(b)]) { x.push(px); y.push(py); z.push(pz); }
      x.push(null); y.push(null); z.push(null);
    }
    shown.push({ type: "scatter3d", mode: "lines", x, y, z, hoverinfo: "skip",
      line: { width: 8, color: person.colour } });
    const points = person.joint_names.map((_, k) => point(k));
    const [jx, jy, jz] = [0, 1, 2].map((k) => points.map((p) => p[k]));
    shown.push({ type: "scatter3d", mode: "markers", x: jx, y: jy, z: jz,
      text: person.joint_names.map((name) => `${person.name}, ${plain(name)}`),
      hovertemplate: "%{text}<br>%{x:.3f}, %{y:.3f}, %{z:.3f} m<extra></extra>",
      marker: { size: 3.5, color: "#11151a" } });
  });
  return shown;
}

listeners.push((at) => {
  byId("slider").value = at;
  const n = page.counts[at];
  byId("frame").textContent = `frame ${page.frames[at]}, ${(page.frames[at] / page.fps).toFixed(2)} s, ` +
    `${n} ${n === 1 ? "person" : "people"}`;
});

// Who is seen when -------------------------------------------------------------------------------

const box = byId("presence");
Plotly.react(box, page.people.map((person, number) => ({
  x: page.frames, y: person.shown.map((on) => (on ? number + 1 : null)), name: person.name,
  mode: "lines", line: { width: 14, color: person.colour }, hovertemplate: "frame %{x}",
})), { margin: { l: 90, r: 30, t: 8, b: 36 }, showlegend: false,
  xaxis: { title: { text: "frame" }, range: [page.frames[0], page.frames[nRows - 1]] },
  yaxis: { tickvals: page.people.map((_, k) => k + 1), ticktext: page.people.map((p) => p.name),
    range: [page.people.length + 0.6, 0.4], zeroline: false } }, config);
const now = element("div", "", box);
now.className = "now";
listeners.push(() => {
  const across = box._fullLayout.xaxis;
  now.style.left = `${across._offset + across.l2p(page.frames[row])}px`;
});
box.on("plotly_click", (event) => {
  play(false);
  show(page.frames.findIndex((other) => other >= Number(event.points[0].x)));
});

// Begin ------------------------------------------------------------------------------------------

listeners.push(draw);
show(0);
document.body.dataset.ready = "yes";
