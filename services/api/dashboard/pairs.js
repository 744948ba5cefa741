// Rows side by side: two functions or two runs matched by variant, and rows that differ in one parameter alone.
import { h, put } from "./dom.js";
import { count, fixed, percent, plural } from "./format.js";
import { textOf, titleOf } from "./plots.js";
import { sheet } from "./thumbnails.js";

const OUTCOMES = { broken: "Broken", fixed: "Fixed", "both missed": "Both missed", "both found": "Both found" };
const SHEET = 16;

function pairCards(pairs, rows, caption) {
  const cells = [];
  const cards = pairs.map((pair) => {
    const side = (number, pacc, label) => {
      const row = rows[number], image = h("span", { class: "thumbnail square waiting" });
      cells.push({ row, image });
      return h("a", { href: `#/frames/${row.frame_id}?view=errors&near=1` }, image, h("span", { class: "small number" }, h("strong", {}, percent(pacc)), h("span", { class: "soft clipped" }, label(row))));
    };
    const { title, before, after } = caption(pair);
    return h("div", { class: "pair" }, title ? h("div", { class: "small" }, title) : null, h("div", { class: "beside" }, side(pair.pair.before, pair.pair.pacc_before, before), side(pair.pair.after, pair.pair.pacc_after, after)));
  });
  for (let k = 0; k < cells.length; k += SHEET) sheet(cells.slice(k, k + SHEET), "errors", true);
  return h("div", { class: "pairs" }, cards);
}

export function comparisonPanel({ get, signal, query, state, about, remember }) {
  const sides = Object.entries(about.functions).flatMap(([run, functions]) => functions.map((name) => `${run}:${name}`));
  const several = Object.keys(about.functions).length > 1;
  const text = (side) => { const at = side.indexOf(":"); return several ? `${side.slice(at + 1)} · ${side.slice(0, at)}` : side.slice(at + 1); };
  if (!sides.includes(state.before)) state.before = sides[0];
  if (!sides.includes(state.after)) state.after = sides[1] ?? sides[0];
  let chosen = Boolean(OUTCOMES[state.outcome]);
  if (!chosen) state.outcome = "broken";
  const element = h("div", { class: "stack wide-gap" });
  const choice = (name, label) => {
    const field = h("select", { id: `side-${name}`, on: { change: () => { state[name] = field.value; remember(); load(); } } }, sides.map((side) => h("option", { value: side }, text(side))));
    field.value = state[name];
    return h("label", { class: "inline", for: `side-${name}` }, label, field);
  };
  const load = async () => {
    if (state.before === state.after) {
      put(element, "same", h("p", { class: "soft" }, sides.length < 2 ? "There is one function only. Explore two runs together, or a run of two functions, to compare them." : "Choose two different sides."));
      return;
    }
    const { comparison: one, rows } = await get(`/v1/explore/comparison?${query({ before: state.before, after: state.after, outcome: state.outcome })}`, { signal });
    const most = Object.keys(OUTCOMES).find((name) => one.outcomes[name]);
    if (!chosen && most && !one.outcomes[state.outcome]) { // the first outcome that shows something
      state.outcome = most;
      await load();
      return;
    }
    const points = (value) => `${value > 0 ? "+" : value < 0 ? "−" : ""}${fixed(Math.abs(100 * value))}`;
    const change = one.difference === null ? "" : `Mean pACC ${points(one.difference)} points${one.low === null ? "" : `, 95 % interval ${points(one.low)} to ${points(one.high)}`}, over ${plural(one.places, "place")}.`;
    const outcomes = h("div", { class: "segments", role: "group", "aria-label": "Outcome" }, Object.entries(OUTCOMES).map(([name, label]) =>
      h("button", { type: "button", "aria-pressed": String(name === state.outcome), on: { click: () => { chosen = true; state.outcome = name; remember(); load(); } } }, `${label} `, h("span", { class: "number" }, count(one.outcomes[name])))));
    const unmatched = one.rows[0] - one.matched;
    put(element, [one, state.outcome], outcomes,
      h("p", { class: "small soft" }, `${plural(one.matched, "person")} matched${unmatched > 0 ? `; ${count(unmatched)} of the first side have no partner with a pACC` : ""}. ${change} Found means pACC ≥ ${fixed(about.threshold, 2)}.`),
      one.pairs.length ? pairCards(one.pairs.map((pair) => ({ pair })), rows, ({ pair }) => ({ title: `Variant ${rows[pair.before].variant_index}, ${rows[pair.before].camera}`, before: (row) => row.function, after: (row) => (several ? row.run_id : row.function) })) : h("p", { class: "soft" }, `Nothing is ${OUTCOMES[state.outcome].toLowerCase()}.`));
  };
  return { element, tools: [choice("before", "From"), choice("after", "to")], load };
}

export function swingsPanel({ get, signal, query, columns }) {
  const element = h("div", { class: "stack wide-gap" });
  const load = async () => {
    const { swings, rows } = await get(`/v1/explore/swings?${query({ limit: 6 })}`, { signal });
    if (!swings.length) {
      put(element, "none", h("p", { class: "soft" }, "No two selected rows differ in one varied parameter alone. A design that draws its variants has no such rows; a grid has."));
      return;
    }
    const parameters = [...new Set(swings.map((one) => one.parameter))];
    put(element, swings, h("p", { class: "small soft" }, "Pairs of rows that differ in one varied parameter alone, the furthest apart in pACC first."),
      parameters.map((name) => {
        const column = columns.get(name) ?? { title: name, group: "varied", scale: 1, unit: "", digits: null };
        return h("section", { class: "stack", "aria-label": titleOf(column) }, h("h3", {}, titleOf(column)), pairCards(swings.filter((one) => one.parameter === name), rows, ({ pair }) => ({
          title: `Variants ${rows[pair.before].variant_index} and ${rows[pair.after].variant_index}, ${rows[pair.before].function}`, before: (row) => textOf(column, row[name]), after: (row) => textOf(column, row[name]) })));
      }));
  };
  return { element, tools: [], load };
}
