// The telemetry socket: always the present state, reconnecting by itself with growing patience.

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 10000;
const SILENCE_MS = 20000;

/** Calls onState(document) for every message and onLink("connecting" | "live" | "lost", seconds) on changes. */
export function follow(onState, onLink) {
  let wait = FIRST_WAIT_MS;
  let quiet;
  let retry;

  function open() {
    clearTimeout(retry);
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/api/stream`);
    const listen = () => {
      clearTimeout(quiet);
      quiet = setTimeout(() => socket.close(), SILENCE_MS);
    };
    socket.addEventListener("message", (event) => {
      wait = FIRST_WAIT_MS;
      listen();
      onLink("live");
      onState(JSON.parse(event.data));
    });
    socket.addEventListener("close", async () => {
      clearTimeout(quiet);
      if (await signedOut()) {
        location.reload();
        return;
      }
      onLink("lost", Math.round(wait / 1000) || 1);
      retry = setTimeout(open, wait);
      wait = Math.min(wait * 1.7, LONGEST_WAIT_MS);
    });
  }

  addEventListener("online", () => {
    wait = FIRST_WAIT_MS;
  });
  onLink("connecting");
  open();
}

async function signedOut() {
  try {
    return (await fetch("/api/mission", { cache: "no-store" })).status === 401;
  } catch {
    return false;
  }
}
