// Polling while a view is shown and its tab is visible.

export function poll(signal, ask) {
  let timer = null;
  let running = false;
  const round = async () => {
    if (signal.aborted || running) return;
    clearTimeout(timer);
    if (document.hidden) return; // the event below polls when the tab becomes visible
    running = true;
    let pause;
    try {
      pause = await ask();
    } catch (error) {
      if (error.name === "AbortError") return;
      pause = 5000;
    } finally {
      running = false;
    }
    if (!signal.aborted && pause) timer = setTimeout(round, pause);
  };
  document.addEventListener("visibilitychange", () => { if (!document.hidden) round(); }, { signal });
  signal.addEventListener("abort", () => clearTimeout(timer));
  round();
  return round;
}
