// Say within five seconds that the server does not answer, and take it back when it does.
const EVERY = 2500;
const PATIENCE = 2000;

export function watch(notice) {
  const look = async () => {
    if (document.hidden) return; // the event below looks when the tab becomes visible
    try {
      await fetch("/healthz", { cache: "no-store", signal: AbortSignal.timeout(PATIENCE) });
      notice.hidden = true;
    } catch {
      notice.hidden = false;
    }
  };
  document.addEventListener("visibilitychange", look);
  setInterval(look, EVERY);
}
