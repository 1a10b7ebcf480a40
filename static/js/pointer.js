// What the panel in the view says of itself: the armed tool and refusals, shown beside the pointer, and the
// visible layers.

const LOOK_MS = 150;
const REFUSAL_MS = 4500;

/** Shows tool and refusals in `label` beside the pointer over `frame`; calls onLayers(Set of names) on changes. */
export function watchPanel(frame, label, onLayers) {
  let layers;
  let told = "0";
  let refusedUntil = 0;
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
    const { hint = "", layers: visible = "", refusal = "", refusals = "0" } = state.dataset;
    if (refusals !== told) {
      refusedUntil = refusals === "0" ? 0 : Date.now() + REFUSAL_MS;
      told = refusals;
    }
    const refused = Date.now() < refusedUntil;
    const text = refused ? refusal : hint;
    if (label.textContent !== text) label.textContent = text;
    label.classList.toggle("refused", refused);
    label.hidden = text === "";
    if (visible !== layers) {
      layers = visible;
      onLayers(new Set(visible.split(" ")));
    }
  }, LOOK_MS);
}
