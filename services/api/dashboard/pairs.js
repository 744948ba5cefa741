// Rows side by side: two functions or two runs matched by variant, and rows that differ in one parameter alone.
import { h, put } from "./dom.js";
import { count, fixed, percent, plural } from "./format.js";
import { LIGHTS, lightTitle } from "./light.js";
import { textOf, titleOf } from "./plots.js";
import { errorLegend, sheet } from "./thumbnails.js";

const OUTCOMES = { broken: "Broken", fixed: "Fixed", "both missed": "Both missed", "both found": "Both found", lower: "Lower", higher: "Higher" };
const SUN = "sun_elevation_deg";
const SHEET = 16;
const DIFFERING = 5; // differences of specs that are named

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

export function comparisonPanel({ get, signal, query, state, runs, runName, about, columns, remember, refresh }) {
  const sides = Object.entries(about.functions).flatMap(([run, functions]) => functions.map((name) => `${run}:${name}`));
  const several = runs.length > 1;
  const split = (side) => { const at = side.indexOf(":"); return [side.slice(0, at), side.slice(at + 1)]; };
  const full = (side) => { const [run, name] = split(side); return several ? `${name} · ${runName(run)}` : name; };
  const sameRun = () => split(state.before)[0] === split(state.after)[0];
  // The part that tells the sides apart.
  const text = (side) => { const [run, name] = split(side); return sameRun() ? name : split(state.before)[1] === split(state.after)[1] ? runName(run) : full(side); };
  if (!sides.includes(state.before)) state.before = sides[0];
  // By default another run's results of the same function.
  if (!sides.includes(state.after)) state.after = sides.find((side) => side !== state.before && split(side)[1] === split(state.before)[1]) ?? sides.find((side) => side !== state.before) ?? state.before;
  // Sides of one run are named by their functions; of two runs, the second is the newer one.
  const labels = () => (sameRun() ? { ...OUTCOMES, broken: `Only ${text(state.after)} misses`, fixed: `Only ${text(state.before)} misses`, lower: `${text(state.after)} lower`, higher: `${text(state.before)} lower` } : OUTCOMES);
  const element = h("div", { class: "stack wide-gap" });
  const choice = (name, label) => {
    const field = h("select", { id: `side-${name}`, on: { change: () => { state[name] = field.value; state.across = []; remember(); load(); } } }, sides.map((side) => h("option", { value: side }, full(side))));
    field.value = state[name];
    return h("label", { class: "inline", for: `side-${name}` }, label, field);
  };
  const light = lightChoice(columns.get(SUN), state, refresh);
  const load = async () => {
    light.draw();
    const chosen = Boolean(OUTCOMES[state.outcome]);
    let outcome = chosen ? state.outcome : "broken";
    if (state.before === state.after) {
      put(element, "same", h("p", { class: "soft" }, sides.length < 2 ? "There is one function only. Explore two runs together, or a run of two functions, to compare them." : "Choose two different sides."));
      return;
    }
    const ask = () => get(`/v1/explore/comparison?${query({ before: state.before, after: state.after, outcome, across: state.across })}`, { signal });
    let { comparison: one, differs, rows } = await ask();
    // Until somebody chooses: what the worse side misses alone, else where it is lower, else the first outcome that shows something.
    const worse = one.difference > 0 ? ["fixed", "higher"] : one.difference < 0 ? ["broken", "lower"] : [];
    const shown = chosen ? outcome : [...worse, ...Object.keys(OUTCOMES)].find((name) => one.outcomes[name]) ?? outcome;
    if (shown !== outcome) {
      outcome = shown;
      ({ comparison: one, rows } = await ask());
    }
    const outcomes = h("div", { class: "segments", role: "group", "aria-label": "Outcome" }, Object.entries(labels()).map(([name, label]) =>
      h("button", { type: "button", "aria-pressed": String(name === outcome), on: { click: () => { state.outcome = name; remember(); load(); } } }, `${label} `, h("span", { class: "number" }, count(one.outcomes[name])))));
    const unmatched = one.rows[0] - one.matched;
    const crossed = (path) => state.across.includes(path);
    const across = one.held.length ? h("div", { class: "row" }, h("span", { class: "small soft" }, "Match across"), h("div", { class: "segments", role: "group", "aria-label": "Match across" }, one.held.map((path) =>
      h("button", { type: "button", title: "Each run holds it at a value of its own; persons match although it differs.", "aria-pressed": String(crossed(path)), on: { click: () => { state.across = crossed(path) ? state.across.filter((other) => other !== path) : [...state.across, path]; remember(); load(); } } }, titleOf(columns.get(path)))))) : null;
    put(element, [one, outcome, state.across], across, verdict(one, text(state.before), text(state.after)), ofFrames(one), differing(differs), outcomes,
      h("p", { class: "small soft" }, `${plural(one.matched, "person")} matched${unmatched > 0 ? `; ${count(unmatched)} of the first side have no partner with a pACC` : ""}. Found means pACC ≥ ${fixed(about.threshold, 2)}.`),
      one.pairs.length ? [errorLegend(), pairCards(one.pairs.map((pair) => ({ pair })), rows, ({ pair }) => ({ title: `Variant ${rows[pair.before].variant_index}, ${rows[pair.before].camera}`, before: () => text(state.before), after: () => text(state.after) }))] : h("p", { class: "soft" }, one.matched ? `No person: ${labels()[outcome].toLowerCase()}.` : "No person of one side has a partner on the other."));
  };
  return { element, tools: [light.element, choice("before", "From"), choice("after", "to")].filter(Boolean), load };
}

// What else than the rows may explain a difference of two runs.
function differing(differs) {
  if (!differs.length) return null;
  const rest = differs.length - DIFFERING;
  return h("p", { class: "small soft" }, `The runs differ in ${differs.slice(0, DIFFERING).join("; ")}${rest > 0 ? `; and ${count(rest)} more` : ""}.`);
}

const points = (value) => fixed(Math.abs(100 * value));
const signed = (value) => `${value > 0 ? "+" : value < 0 ? "−" : ""}${points(value)}`;

// Which side is worse, by how much and how surely.
function verdict({ difference, low, high, places }, before, after) {
  if (difference === null) return null;
  if (!difference) return h("p", {}, `${before} and ${after} have the same mean pACC, over ${plural(places, "place")}.`);
  const [worse, better, ends] = difference < 0 ? [after, before, [low, high]] : [before, after, [-high, -low]];
  const sure = low !== null && (low > 0 || high < 0);
  return h("p", {}, h("strong", {}, sure ? `${worse} is worse than ${better}` : `${worse} and ${better} cannot be told apart`), `: the mean pACC of ${worse} is ${points(difference)} points lower`,
    low === null ? `, over ${plural(places, "place")}.` : ` (95 % interval of the change ${signed(ends[0])} to ${signed(ends[1])} for places like these), over ${plural(places, "place")}.`,
    low === null ? " There is no interval." : sure ? "" : " The interval contains 0, so the order may be chance.");
}

// Precision and IoU belong to a frame, not to a person.
function ofFrames({ precision, iou }) {
  const change = (name, [before, after]) => (before === null || after === null ? null : `pooled ${name} ${percent(before)} → ${percent(after)} (${signed(after - before)} points)`);
  const changes = [change("precision", precision), change("IoU", iou)].filter(Boolean);
  return changes.length ? h("p", { class: "small soft", title: "From the pixels of all frames together. The page of a run has the mean over its frames." }, `Of their frames: ${changes.join(", ")}; no interval.`) : null;
}

// Buttons that select by the kind of light, if the rows have several; they brush the sun's elevation.
function lightChoice(sun, state, refresh) {
  const fits = sun?.numeric ? Object.entries(LIGHTS).filter(([, { low, high }]) => sun.low < high && sun.high >= low) : [];
  if (fits.length < 2) return { element: null, draw: () => {} };
  const element = h("div", { class: "segments", role: "group", "aria-label": "Light" });
  const draw = () => {
    const brush = state.brushes.of.get(SUN);
    const button = (label, range) => h("button", { type: "button", title: range && lightTitle(range), "aria-pressed": String(range ? brush?.low === range.low && brush?.high === range.high : !brush),
      on: { click: () => { state.brushes.set(SUN, range && { low: range.low, high: range.high, closed: false }); refresh(); } } }, label);
    put(element, [brush ?? null], button("Any light", null), fits.map(([label, range]) => button(label, range)));
  };
  return { element, draw };
}

export function swingsPanel({ get, signal, query, columns, several }) {
  const element = h("div", { class: "stack wide-gap" });
  const load = async () => {
    const { swings, rows } = await get(`/v1/explore/swings?${query({ limit: 6 })}`, { signal });
    if (!swings.length) {
      put(element, "none", h("p", { class: "soft" }, "No two selected rows differ in one varied parameter alone. A design that draws its variants has no such rows; a grid has."));
      return;
    }
    const parameters = [...new Set(swings.map((one) => one.parameter))];
    put(element, swings, h("p", { class: "small soft" }, "Pairs of rows that differ in one varied parameter alone, the furthest apart in pACC first."), errorLegend(),
      parameters.map((name) => {
        const column = columns.get(name) ?? { title: name, group: "varied", scale: 1, unit: "", digits: null };
        return h("section", { class: "stack", "aria-label": titleOf(column) }, h("h3", {}, titleOf(column)), pairCards(swings.filter((one) => one.parameter === name), rows, ({ pair }) => ({
          title: [`Variants ${rows[pair.before].variant_index} and ${rows[pair.after].variant_index}`, rows[pair.before].function, several.includes("camera") ? rows[pair.before].camera : null].filter(Boolean).join(", "), before: (row) => textOf(column, row[name]), after: (row) => textOf(column, row[name]) })));
      }));
  };
  return { element, tools: [], load };
}
