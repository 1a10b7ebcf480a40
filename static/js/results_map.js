// A mission from above: the ground's picture, watchers, and every method's way, which the list beneath switches.

const SVG = "http://www.w3.org/2000/svg";

function node(name, attributes) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

function look(map, [west, east, south, north]) {
  map.setAttribute("viewBox", `${west} ${-north} ${east - west} ${north - south}`);
}

const points = (xs, ys) => xs.map((x, place) => `${x},${-ys[place]}`).join(" ");

/** Draws a scene as /api/results/{id}/scenes/{mission} gives it; metres, north up. */
export function drawScene(map, list, scene, picture, methods) {
  const [west, east, south, north] = scene.bounds;
  const metre = (scene.view[1] - scene.view[0]) / 100;
  look(map, scene.view);
  map.onclick = () => look(map, map.classList.toggle("whole") ? scene.bounds : scene.view);
  map.classList.remove("whole");
  const hint = node("title", {});
  hint.textContent = "click for the whole map, and back";
  map.replaceChildren(hint, node("image", {
    href: picture, x: west, y: -north, width: east - west, height: north - south, preserveAspectRatio: "none",
  }));
  for (const watcher of scene.watchers) {
    const sector = watcher.sector.map(([x, y]) => `${x},${-y}`).join(" ");
    map.append(node("polygon", { points: sector, fill: "#f09128", "fill-opacity": 0.13 }));
    const size = 1.3 * metre;
    const mark = `M${watcher.x - size},${-watcher.y + size} h${2 * size} l${-size},${-2 * size} z`;
    map.append(node("path", { d: mark, fill: watcher.known ? "#f09128" : "#96989c", stroke: "#1a1b1e", "stroke-width": 0.25 * metre }));
  }
  const ends = { stroke: "#1a1b1e", "stroke-width": 0.25 * metre };
  map.append(node("circle", { cx: scene.start[0], cy: -scene.start[1], r: metre, fill: "#c4ced6", ...ends }));
  map.append(node("circle", { cx: scene.goal[0], cy: -scene.goal[1], r: 1.3 * metre, fill: "#f4ce42", ...ends }));
  list.replaceChildren(...scene.drives.map((drive) => way(map, drive, methods)));
}

function way(map, drive, methods) {
  const colour = methods.find((method) => method.name === drive.method)?.colour ?? "#ffffff";
  const group = node("g", {});
  const line = { points: points(drive.x, drive.y) };
  const top = node("polyline", { ...line, class: "way", stroke: colour });
  group.append(node("polyline", { ...line, class: "way under" }), top);
  map.append(group);

  const entry = document.createElement("li");
  const label = document.createElement("label");
  const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: true });
  const swatch = document.createElement("span");
  swatch.className = "swatch";
  swatch.style.setProperty("--colour", colour);
  const seen = drive.exposed_s === null ? "" : `, seen ${drive.exposed_s.toFixed(1)} s`;
  label.append(box, " ", swatch, `${drive.method}: ${drive.status.replaceAll("_", " ")} in ${drive.execution_time_s?.toFixed(1) ?? "–"} s${seen}`);
  box.addEventListener("change", () => { group.style.display = box.checked ? "" : "none"; });
  entry.addEventListener("pointerenter", () => { top.classList.add("strong"); map.append(group); });
  entry.addEventListener("pointerleave", () => top.classList.remove("strong"));
  entry.append(label);
  return entry;
}
