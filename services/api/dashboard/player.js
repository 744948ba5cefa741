// Player of a sequence: a slider over its frames, and playback at the speed of the recording.
import { h } from "./dom.js";

const SHORTEST_MS = 40;
let held = false; // the slider keeps the focus while a keyboard moves it from frame to frame

// `show(id)` shows the pictures of another frame and resolves when they are loaded; `open(id)` opens its page.
export function player(frame, { show, open, signal }) {
  if (!frame.sequence || frame.sequence.frames < 2) return null;
  const { frames, step_s: step } = frame.sequence;
  const id = (index) => frame.id.replace(/\.\d+$/, `.${index}`);
  const label = (index) => `${(frame.time_s + (index - frame.time_index) * step).toFixed(2)} s`;
  let now = frame.time_index;
  let playing = false;

  const preview = (index) => {
    now = index;
    slider.value = index;
    slider.setAttribute("aria-valuetext", label(index));
    said.textContent = `${label(index)} · frame ${index + 1} of ${frames}`;
    return show(id(index));
  };
  const slider = h("input", { type: "range", min: 0, max: frames - 1, value: now, "aria-label": "Moment", on: {
    input: () => { playing = false; preview(Number(slider.value)); },
    change: () => { held = true; open(id(Number(slider.value))); },
    blur: () => { if (slider.isConnected) held = false; },
  } });
  const said = h("span", { class: "number soft" });
  const button = h("button", { type: "button", on: { click: () => (playing ? stop() : play()) } }, "▶ Play");

  const play = async () => {
    playing = true;
    button.textContent = "⏸ Pause";
    while (playing && !signal.aborted) {
      const due = performance.now() + Math.max(1000 * step, SHORTEST_MS);
      await preview((now + 1) % frames); // the first round waits for pictures, which are kept then
      await new Promise((resolve) => setTimeout(resolve, Math.max(0, due - performance.now())));
    }
  };
  const stop = () => {
    playing = false;
    button.textContent = "▶ Play";
    open(id(now)); // the tables below belong to one frame
  };
  said.textContent = `${label(now)} · frame ${now + 1} of ${frames}`;
  slider.setAttribute("aria-valuetext", label(now));
  const element = h("div", { class: "player under", role: "group", "aria-label": "Sequence" }, button, slider, said);
  if (held) requestAnimationFrame(() => slider.focus());
  return element;
}
