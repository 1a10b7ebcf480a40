// The list of keys, and their way into the 3D view when the page around it has the focus.

export const KEYS = [
  ["Space", "play or pause"],
  ["N", "one step"],
  ["F", "follow the robot"],
  ["T", "view from above, and back"],
  ["H", "opening view"],
  ["Esc", "put the tool down, or deselect"],
  ["Delete", "delete what is selected"],
  ["Ctrl Z", "undo"],
  ["Ctrl Shift Z", "redo"],
  ["G", "tool: goal"],
  ["S", "tool: start"],
  ["O", "tool: observer"],
  ["C", "tool: cover"],
  ["B", "tool: person or vehicle"],
  ["P", "tool: patrol points"],
  ["M", "tool: move"],
  ["R", "tool: rotate"],
  ["X", "tool: delete"],
  ["E", "explain: who sees a place, and why"],
  ["V", "show or hide the exposure"],
  ["L", "show or hide the sight lines"],
  ["1 – 9", "show and hide layers"],
  ["Ctrl K", "all commands"],
  ["?", "this list"],
];

const typing = (target) => target?.closest?.("input, textarea, select, [contenteditable]") != null;

export function listKeys(list) {
  for (const [keys, meaning] of KEYS) {
    const row = document.createElement("div");
    const name = document.createElement("span");
    const held = document.createElement("span");
    name.textContent = meaning;
    for (const key of keys.split(" ")) {
      if (key === "–") held.append(" – ");
      else held.append(Object.assign(document.createElement("kbd"), { textContent: key }), " ");
    }
    row.append(name, held);
    list.append(row);
  }
}

// A button that was clicked keeps the focus, and Space would press it again instead of playing.
function letGo(page) {
  page.addEventListener("click", (event) => {
    if (event.detail > 0) event.target.closest?.("button")?.blur();
  });
}

/** Calls `toggle` for "?", wherever the focus is, and hands other keys of the page on to the view. */
export function routeKeys(frame, toggle) {
  const help = (event) => {
    if (event.key !== "?" || typing(event.target)) return false;
    event.preventDefault();
    toggle();
    return true;
  };
  const inView = (view) => {
    view.addEventListener("keydown", help);
    letGo(view.document);
  };
  letGo(document);
  frame.addEventListener("load", () => inView(frame.contentWindow));
  if (frame.contentDocument?.readyState === "complete") inView(frame.contentWindow);

  document.addEventListener("keydown", (event) => {
    const own = event.target.closest?.("dialog, a, button") != null && ["Enter", " ", "Escape"].includes(event.key);
    if (help(event) || own || typing(event.target) || event.key === "Tab") return;
    const body = frame.contentDocument?.body;
    if (!body) return;
    const copy = new frame.contentWindow.KeyboardEvent("keydown", {
      key: event.key, code: event.code, keyCode: event.keyCode, repeat: event.repeat, bubbles: true, cancelable: true,
      ctrlKey: event.ctrlKey, shiftKey: event.shiftKey, altKey: event.altKey, metaKey: event.metaKey,
    });
    const unhandled = body.dispatchEvent(copy);
    if (!unhandled || event.key === " ") event.preventDefault();
  });
}
