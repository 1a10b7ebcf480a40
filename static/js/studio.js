// The page around the 3D view: the bar, the legend, the first hints, the keys.

import { listKeys, routeKeys } from "./keys.js";
import { watchPanel } from "./pointer.js";
import { follow } from "./stream.js";

const $ = (id) => document.getElementById(id);
const FAILED = new Set(["collided", "rolled_over", "timeout", "stuck", "unreachable"]);
const VISITED = "covernav.visited";
const GREETED = "covernav.greeted"; // once is enough, however often the page is loaded
const METHODS = { least_cost: "least cost", dwa: "plain DWA" };

let status = "idle";

function showState(state) {
  status = state.status;
  $("scenario").textContent = state.scenario?.name ?? "";
  document.title = state.scenario ? `${state.scenario.name} · CoverNav Studio` : "CoverNav Studio";
  $("unsaved").hidden = !state.dirty;
  $("message").textContent = state.message ?? state.status;
  $("message").title = state.message ?? "";
  $("status").dataset.status = state.status;
  $("status").toggleAttribute("data-trouble", Boolean(state.error) || FAILED.has(state.status));
  $("method").textContent = METHODS[state.method] ?? state.method.replaceAll("_", " ");
  const reached = state.status === "running" && state.real_factor ? ` (${state.real_factor.toFixed(1)}×)` : "";
  $("speed").textContent = `${fraction(state.speed)}×${reached}`;
  $("play").toggleAttribute("data-running", status === "running");
  $("play").setAttribute("aria-label", status === "running" ? "Pause" : "Play");
}

const fraction = (speed) => ({ 0.125: "⅛", 0.25: "¼", 0.5: "½" })[speed] ?? String(speed);

function showLink(link, seconds) {
  $("link").dataset.state = link;
  $("link").lastElementChild.textContent = link;
  if (link === "lost") {
    $("status").toggleAttribute("data-trouble", true);
    $("message").textContent = `no connection to the studio; trying again in ${seconds} s. Nothing saved is lost.`;
  }
}

async function command(path) {
  try {
    const answer = await fetch(path, { method: "POST" });
    if (!answer.ok) $("message").textContent = (await answer.json()).detail ?? "that was refused";
  } catch {
    // the link's own state tells
  }
}

function remember(key, value) {
  try {
    localStorage.setItem(key, value);
  } catch {
    // private windows may refuse; then the hints come again
  }
}

function recall(key) {
  try {
    return localStorage.getItem(key);
  } catch {
    return null;
  }
}

function welcome() {
  const visited = recall(VISITED) !== null;
  let greeted = visited || recall(GREETED) !== null || location.hash === "#replay"; // there something moves already
  $("hints").hidden = visited;
  $("hints-button").addEventListener("click", () => {
    $("hints").hidden = true;
    remember(VISITED, "yes");
  });
  return (state) => {
    if (greeted) return;
    greeted = true;
    remember(GREETED, "yes");
    if (state.status === "idle") command("/api/mission/start");
  };
}

function keysDialog() {
  listKeys($("keys-list"));
  const toggle = () => ($("keys").open ? $("keys").close() : $("keys").showModal());
  $("keys-button").addEventListener("click", toggle);
  routeKeys($("viewer"), toggle);
}

function legend() {
  const button = $("legend-button");
  const fold = (open) => button.setAttribute("aria-expanded", String(open));
  fold(recall("covernav.legend") !== "folded");
  button.addEventListener("click", () => {
    const open = button.getAttribute("aria-expanded") !== "true";
    fold(open);
    remember("covernav.legend", open ? "open" : "folded");
  });
  return (layers) => {
    for (const section of $("legend-body").children) section.hidden = !layers.has(section.dataset.layer);
  };
}

const greet = welcome();
keysDialog();
watchPanel($("viewer"), $("pointer"), legend());
$("play").addEventListener("click", () => command(status === "running" ? "/api/mission/pause" : "/api/mission/start"));
follow((state) => {
  showState(state);
  greet(state);
}, showLink);
