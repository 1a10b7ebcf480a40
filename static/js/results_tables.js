// Tables of the results page. What files say is only ever set as text.

const COLUMNS = [
  ["length, m", "trajectory_length_m", 1, 1],
  ["ratio", "length_ratio", 2, 1],
  ["mission, s", "execution_time_s", 1, 1],
  ["exposed, s", "exposed_s", 1, 1],
  ["longest, s", "longest_exposure_s", 1, 1],
  ["detected, %", "detection_probability", 0, 100],
  ["avoidable removed, %", "avoidable_removed", 0, 100],
  ["in cover, %", "cover_fraction", 0, 100],
  ["concealed, %", "concealed_fraction", 0, 100],
  ["climb and fall, m", "elevation_gradient_m", 2, 1],
  ["violations", "dynamic_violations", 2, 1],
  ["collided, %", "collision_rate", 0, 100],
  ["timeout, %", "timeout_rate", 0, 100],
  ["planner, ms", "planner_ms_p50", 0, 1],
];
const WITH_INTERVAL = new Set(["exposed_s", "execution_time_s", "avoidable_removed"]);
const BOUND = { trajectory_length_m: "bound_m", exposed_s: "bound_s" };

export function cell(tag, text, kind = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

// Halves go to the even digit, as in the exported tables and the report.
const STYLES = [0, 1, 2].map((digits) => new Intl.NumberFormat("en", {
  minimumFractionDigits: digits, maximumFractionDigits: digits, useGrouping: false, roundingMode: "halfEven",
}));

const number = (value, digits, scale = 1) => (value === null || value === undefined ? "–" : STYLES[digits].format(scale * value));

function range([low, high], digits, scale) {
  return `${number(low, digits, scale)}${low < 0 ? " to " : "–"}${number(high, digits, scale)}`;
}

function aside(into, text, kind) {
  into.append(" ", cell("span", text, kind));
}

export function showTable(table, rows, bounds, methods) {
  const head = document.createElement("thead");
  head.insertRow().append(
    cell("th", "terrain", "text"), cell("th", "method", "text"), cell("th", "n"), cell("th", "success, %"),
    ...COLUMNS.map(([name]) => cell("th", name)), cell("th", "failures", "text"),
  );
  const body = document.createElement("tbody");
  rows.forEach((row, place) => {
    const first = place === 0 || rows[place - 1].terrain !== row.terrain;
    body.append(methodRow(row, first, methods));
    const bound = bounds.find((each) => each.terrain === row.terrain);
    if (bound && rows[place + 1]?.terrain !== row.terrain) body.append(boundRow(bound));
  });
  table.replaceChildren(head, body);
}

function methodRow(row, first, methods) {
  const line = document.createElement("tr");
  if (first) line.className = "first";
  const method = methods.find((each) => each.name === row.method);
  const name = cell("td", "", "text");
  const swatch = cell("span", "", "swatch");
  swatch.style.setProperty("--colour", method?.colour ?? "#888");
  name.append(swatch, row.method);
  name.title = method?.description ?? "";
  const success = cell("td", number(row.success_rate, 0, 100));
  aside(success, `(${number(row.success_ci95[0], 0, 100)}–${number(row.success_ci95[1], 0, 100)})`, "interval");
  paper(success, row, "success_rate", 100);
  line.append(cell("td", first ? row.terrain.replaceAll("_", "-") : "", "text"), name, cell("td", String(row.missions)), success);
  for (const [, key, digits, scale] of COLUMNS) {
    const made = cell("td", number(row[key], digits, scale));
    const interval = WITH_INTERVAL.has(key) ? row.ci95[key] : null;
    if (interval) aside(made, `(${range(interval, digits, scale)})`, "interval");
    if (row.n[key] !== undefined) made.title = `over ${row.n[key]} drives`;
    paper(made, row, key, 1);
    line.append(made);
  }
  const failures = Object.entries(row.failures).map(([reason, count]) => `${count} ${reason.replaceAll("_", " ")}`);
  line.append(cell("td", failures.join(", ") || "none", "text"));
  return line;
}

function paper(into, row, key, scale) {
  if (row.paper && row.paper[key] !== undefined) aside(into, `paper ${number(row.paper[key], 0, scale)}`, "paper");
}

function boundRow(bound) {
  const line = document.createElement("tr");
  line.className = "bound";
  const name = cell("td", "least exposed route", "text");
  name.title = "of at most twice the shortest's length, as the route engine reckons it; a drive may come out below";
  line.append(cell("td", "", "text"), name, cell("td", String(bound.missions)), cell("td", ""));
  for (const [, key, digits] of COLUMNS) line.append(cell("td", BOUND[key] ? number(bound[BOUND[key]], digits) : ""));
  line.append(cell("td", "", "text"));
  return line;
}

const MEASURES = [
  ["success, points", "success", 100],
  ["exposed, s", "exposed_s", 1],
  ["mission, s", "execution_time_s", 1],
  ["climb and fall, m", "elevation_gradient_m", 1],
  ["tilt, °", "max_tilt_deg", 1],
];

export function showPaired(table, rows) {
  const head = document.createElement("thead");
  head.insertRow().append(cell("th", "terrain", "text"), cell("th", "pairs"), ...MEASURES.map(([name]) => cell("th", name)));
  const body = document.createElement("tbody");
  for (const row of rows) {
    const line = body.insertRow();
    line.append(cell("td", row.terrain.replaceAll("_", "-"), "text"), cell("td", String(row.missions)));
    for (const [, key, scale] of MEASURES) line.append(difference(row[key], scale));
  }
  table.replaceChildren(head, body);
}

function difference(found, scale) {
  if (found.difference === null) return cell("td", "–");
  const signed = (value) => `${value > 0 ? "+" : ""}${number(value, 1, scale)}`;
  const made = cell("td", signed(found.difference));
  if (found.ci95) aside(made, `(${signed(found.ci95[0])} to ${signed(found.ci95[1])})`, "interval");
  made.title = `over ${found.n} pairs`;
  return made;
}
