// What the panel in the view says of itself: the armed tool, shown beside the pointer, and the visible layers.

const LOOK_MS = 150;

/** Shows the armed tool in `label` beside the pointer over `frame`; calls onLayers(Set of names) on changes. */
export function watchPanel(frame, label, onLayers) {
  let layers;
  const attach = () => {
    const view = frame.contentWindow;
    view.addEventListener("pointermove", (event) => {
      label.style.left = `${event.clientX + 16}px`;
      label.style.top = `${event.clientY + 18}px`;
    }, { passive: true });
    view.document.documentElement.addEventListener("pointerleave", () => label.classList.add("away"));
    view.document.documentElement.addEventListener("pointerenter", () => label.classList.remove("away"));
  };
  frame.addEventListener("load", attach);
  if (frame.contentDocument?.readyState === "complete") attach();

  setInterval(() => {
    const state = frame.contentDocument?.getElementById("covernav-state");
    if (!state) return;
    const { hint = "", layers: visible = "" } = state.dataset;
    if (label.textContent !== hint) label.textContent = hint;
    label.hidden = hint === "";
    if (visible !== layers) {
      layers = visible;
      onLayers(new Set(visible.split(" ")));
    }
  }, LOOK_MS);
}
