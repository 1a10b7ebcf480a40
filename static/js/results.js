// The results page: an evaluation's table, figures and missions; everything comes from /api/results.

import { showTable, showPaired, cell } from "./results_tables.js";
import { drawScene } from "./results_map.js";

const $ = (id) => document.getElementById(id);
let shown = null; // the evaluation's overview
let drives = []; // of the chosen kind of missions
let chosen = null; // the mission on the map
let wantedPairs = ""; // what was asked for last; late answers to what was asked before are dropped
let wantedMissions = "";

async function ask(path, options) {
  const answer = await fetch(path, options);
  if (answer.status === 401) location.reload();
  const document = answer.headers.get("content-type")?.startsWith("application/json") ? await answer.json() : null;
  if (!answer.ok) throw new Error(document?.detail ?? `that failed (${answer.status})`);
  return document;
}

/** Runs what a person asked for; a refusal is said in the bar. */
function attempt(action) {
  return async (event) => {
    $("problem").textContent = "";
    try {
      await action(event);
    } catch (error) {
      $("problem").textContent = error.message;
      $("problem").title = error.message;
    }
  };
}

function offer(select, options, wanted) {
  select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
  if (options.some(([value]) => String(value) === String(wanted))) select.value = wanted;
}

const here = (path) => `/api/results/${encodeURIComponent(shown.id)}${path}`;
const kind = () => Number($("kind").value || 0);

async function list(wanted) {
  const entries = await ask("/api/results");
  $("nothing").hidden = entries.length > 0;
  $("content").hidden = entries.length === 0;
  offer($("evaluation"), entries.map((entry) => [entry.id, entry.problem ? `${entry.title} (damaged)` : entry.title]), wanted);
  if (entries.length) await open();
}

async function open() {
  const wanted = $("evaluation").value;
  const found = await ask(`/api/results/${encodeURIComponent(wanted)}`).catch((error) => {
    if ($("evaluation").value === wanted) $("content").hidden = true; // nothing of the former stays under its name
    throw error;
  });
  if ($("evaluation").value !== wanted) return; // another was chosen meanwhile
  $("content").hidden = false;
  shown = found;
  offer($("kind"), shown.kinds.map((each) => [each.number, `${each.words} (${each.missions})`]));
  const names = shown.methods.map((method) => [method.name, method.name]);
  offer($("method"), names, "covernav");
  offer($("against"), names, names.find(([name]) => name !== $("method").value)?.[0]);
  for (const [id, path] of [["table-csv", "/table.csv"], ["missions-csv", "/missions.csv"], ["report", "/report.html"], ["file", "/file"]]) {
    $(id).href = here(path);
  }
  await showKind();
}

async function showKind() {
  const of = shown.kinds[kind()];
  const alike = (row) => ["suite", "observers", "placement", "perception", "goal_distance"].every((key) => row[key] === of[key]);
  const [rows, bounds] = [[...shown.rows, ...shown.totals], [...shown.bounds, ...shown.total_bounds]];
  showTable($("table"), rows.filter(alike), bounds.filter(alike), shown.methods);
  for (const name of ["success-exposure", "distributions"]) showFigure(name);
  await Promise.all([pairs(), missions()]);
}

function showFigure(name) {
  const address = (format, theme) => here(`/figures/${name}.${format}?kind=${kind()}&theme=${theme}`);
  $(name).src = address("svg", "dark");
  const links = ["svg", "png"].map((format) =>
    Object.assign(document.createElement("a"), { href: address(format, "light"), download: "", textContent: format.toUpperCase() }));
  $(name).closest("figure").querySelector(".exports").replaceChildren(...links);
}

async function pairs() {
  const query = new URLSearchParams({ method: $("method").value, against: $("against").value });
  const [asked, of] = [`${shown.id} ${kind()} ${query}`, shown.kinds[kind()]];
  wantedPairs = asked;
  const rows = await ask(here(`/paired?${query}`));
  if (wantedPairs !== asked) return;
  showPaired($("paired"), rows.filter((row) => ["suite", "observers", "placement", "perception", "goal_distance"].every((key) => row[key] === of[key])));
}

async function missions() {
  const asked = here(`/missions?kind=${kind()}`);
  wantedMissions = asked;
  const found = await ask(asked);
  if (wantedMissions !== asked) return;
  drives = found;
  const terrains = [...new Set(shown.rows.map((row) => row.terrain))].filter((name) => drives.some((drive) => drive.terrain === name));
  offer($("terrain"), terrains.map((name) => [name, name.replaceAll("_", "-")]), $("terrain").value);
  await showDrives();
}

async function showDrives() {
  const mine = drives.filter((drive) => drive.terrain === $("terrain").value);
  const seeds = [...new Set(mine.map((drive) => drive.label))].sort((a, b) => a.length - b.length || (a < b ? -1 : 1));
  const names = shown.methods.map((method) => method.name).filter((name) => mine.some((drive) => drive.method === name));
  const head = document.createElement("thead");
  head.insertRow().append(cell("th", "seed", "text"), ...names.map((name) => cell("th", name)));
  const body = document.createElement("tbody");
  for (const seed of seeds) {
    const row = body.insertRow();
    const of = names.map((name) => mine.find((drive) => drive.label === seed && drive.method === name));
    row.append(cell("td", seed, "text"), ...of.map(outcome));
    const drawn = of.find((drive) => drive?.drawn);
    if (!drawn) continue;
    row.tabIndex = 0;
    row.dataset.mission = drawn.id;
    const look = attempt(() => show(drawn.id));
    row.addEventListener("click", look);
    row.addEventListener("keydown", (event) => event.key === "Enter" && look());
  }
  $("drives").replaceChildren(head, body);
  const first = body.querySelector("tr[data-mission]");
  $("scene").hidden = !first;
  if (first) await show(Number(first.dataset.mission));
}

function outcome(drive) {
  if (!drive) return cell("td", "–");
  if (!drive.success) return cell("td", drive.status.replaceAll("_", " "), "failed");
  return cell("td", drive.exposed_s === null ? "reached" : `${drive.exposed_s.toFixed(1)} s`);
}

async function show(mission) {
  chosen = mission;
  for (const row of $("drives").querySelectorAll("tbody tr")) {
    row.setAttribute("aria-selected", String(Number(row.dataset.mission) === mission));
  }
  const asked = here(`/scenes/${mission}`);
  const scene = await ask(asked);
  if (chosen !== mission || asked !== here(`/scenes/${mission}`)) return; // another was chosen meanwhile
  $("scene-name").textContent = scene.name;
  drawScene($("map"), $("ways"), scene, here(`/scenes/${mission}/map.jpg`), shown.methods);
  const options = scene.drives.map((drive) => [drive.id, drive.method]);
  offer($("one"), options, scene.drives.find((drive) => drive.method === $("method").value)?.id);
  const rest = scene.drives.filter((drive) => String(drive.id) !== $("one").value);
  offer($("other"), [["", "nobody else"], ...options], (rest.find((drive) => drive.method === $("against").value) ?? rest[0])?.id);
  for (const format of ["svg", "png"]) $(`map-${format}`).href = here(`/figures/trajectories.${format}?mission=${mission}`);
}

async function replay() {
  const them = [...new Set([$("one").value, $("other").value].filter(Boolean).map(Number))];
  const body = JSON.stringify({ missions: them });
  await ask(here("/replay"), { method: "POST", headers: { "content-type": "application/json" }, body });
  location.href = "/#replay";
}

async function upload(event) {
  const file = event.target.files[0];
  event.target.value = "";
  if (!file) return;
  const added = await ask("/api/results", { method: "POST", headers: { "content-type": "application/vnd.sqlite3" }, body: file });
  await list(added.id);
}

$("evaluation").addEventListener("change", attempt(open));
$("kind").addEventListener("change", attempt(showKind));
$("method").addEventListener("change", attempt(pairs));
$("against").addEventListener("change", attempt(pairs));
$("terrain").addEventListener("change", attempt(showDrives));
$("replay").addEventListener("click", attempt(replay));
$("upload").addEventListener("change", attempt(upload));
attempt(() => list())();
