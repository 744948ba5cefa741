// The confusion matrix of a function in the selected rows. A cell opens the frames in which its pixels are.
import { h, put } from "./dom.js";
import { count, fixed, plural } from "./format.js";
import { thumbnails } from "./thumbnails.js";

const FRAMES = 48;

export function confusionPanel({ get, signal, query, columns, state, remember }) {
  const functions = columns.get("function")?.names ?? [];
  if (!functions.includes(state.fn)) state.fn = functions[0];
  const matrix = h("div", {}), caption = h("p", { class: "small soft", "aria-live": "polite" }), grid = thumbnails();
  const element = h("div", { class: "stack wide-gap" }, matrix, caption, grid.element);
  const field = h("select", { id: "confusion-function", on: { change: () => { state.fn = field.value; remember(); load(); } } }, functions.map((name) => h("option", { value: name }, name)));
  field.value = state.fn ?? "";

  const load = async () => {
    if (!state.fn) { put(matrix, "none", h("p", { class: "soft" }, "No function was evaluated.")); return; }
    const [truth, predicted] = (state.cell ?? "").split("~");
    const { confusion, rows } = await get(`/v1/explore/confusion?${query({ function: state.fn, ...(predicted ? { truth, predicted, limit: FRAMES } : {}) })}`, { signal });
    const names = [...confusion.classes, "void"];
    const totals = confusion.counts.map((line) => line.reduce((a, b) => a + b, 0));
    const seen = confusion.classes.map((_, k) => k).filter((k) => totals[k]);
    const called = names.map((_, k) => k).filter((k) => confusion.counts.some((line) => line[k]));
    const cell = (row, column) => {
      const pixels = confusion.counts[row][column], share = totals[row] ? pixels / totals[row] : 0;
      if (!pixels) return h("td", {});
      const name = `${confusion.classes[row]}~${names[column]}`, text = share >= 0.0995 ? fixed(100 * share, 0) : share >= 0.0005 ? fixed(100 * share) : "<0.1";
      const button = h("button", {
        type: "button", class: row === column ? "right-class" : "wrong-class", "aria-pressed": String(name === state.cell),
        title: `${confusion.classes[row]} predicted as ${names[column]}: ${count(pixels)} pixels, ${fixed(100 * share, 2)} %`,
        "aria-label": `${confusion.classes[row]} predicted as ${names[column]}: ${fixed(100 * share, 2)} per cent`,
        on: { click: () => { state.cell = name === state.cell ? null : name; remember(); load(); } } }, text);
      button.style.setProperty("--share", `${Math.round(100 * Math.sqrt(share))}%`);
      return h("td", {}, button);
    };
    put(matrix, [confusion.counts, state.cell], seen.length ? h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Confusion matrix" },
      h("table", { class: "confusion" },
        h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "is \\ predicted"), called.map((k) => h("th", { scope: "col" }, h("span", {}, names[k]))))),
        h("tbody", {}, seen.map((row) => h("tr", {}, h("th", { scope: "row" }, confusion.classes[row]), called.map((column) => cell(row, column)))))))
      : h("p", { class: "soft" }, "No evaluation of this function is selected."));
    const frames = confusion.frames.map((one) => ({ ...rows[one.row], pixels: one.pixels }));
    caption.textContent = predicted
      ? `${plural(frames.length, "frame")}${frames.length === FRAMES ? " or more" : ""} with ${truth} predicted as ${predicted}, most pixels first.`
      : `In per cent of the pixels of a class, over ${plural(confusion.evaluations, "evaluation")}. A cell shows the frames in which its pixels are.`;
    if (predicted) grid.show(frames, { kind: "overlay", crop: false, caption: (row) => [count(row.pixels), "pixels"] });
    else grid.element.replaceChildren();
  };
  return { element, tools: [h("label", { class: "inline", for: "confusion-function" }, "Function", field)], load };
}
