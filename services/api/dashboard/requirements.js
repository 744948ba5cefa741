// The requirements of a spec: identifier, statistic with its bound, region, confidence.
import { h } from "./dom.js";
import { asText, entriesIn, labelled, listOf, problemsAt, read, unused } from "./fields.js";

const KINDS = { share: "share of", mean: "mean of", quantile: "quantile of" };
const SIGNS = [">=", "<="];
const SIGN = String.raw`\s*(>=|<=|≥|≤)\s*`;
const STATISTIC = new RegExp(String.raw`^\s*(?:(share)\s*\(\s*(\w+)${SIGN}([^()]+?)\s*\)|(mean)\s*\(\s*(\w+)\s*\)|(quantile)\s*\(\s*(\w+)\s*,\s*([^()]+?)\s*\))${SIGN}(.+?)\s*$`);
const spelled = (sign) => ({ "≥": ">=", "≤": "<=" })[sign] ?? sign;

// A statistic in parts, or null where it has another form. `of` is the value in a share, or the order of a quantile.
export function partsOf(statistic) {
  const found = STATISTIC.exec(statistic ?? "");
  if (!found) return null;
  const [, share, shared, condition, value, mean, averaged, quantile, ordered, order, sign, bound] = found;
  return { kind: share ?? mean ?? quantile, score: shared ?? averaged ?? ordered, condition: spelled(condition ?? ">="), of: value ?? order ?? "", sign: spelled(sign), bound };
}

export function statisticOf({ kind, score, condition, of, sign, bound }) {
  const inside = kind === "share" ? `${score} ${condition} ${of}` : kind === "quantile" ? `${score}, ${of}` : score;
  return `${kind}(${inside}) ${sign} ${bound}`;
}

const BEGUN = { share: { of: "0.5", bound: "95 %" }, mean: { of: "", bound: "0.8" }, quantile: { of: "0.05", bound: "0.3" } };

// `scores`: those that a requirement may bound, as /v1/measures lists them.
export function requirementFields(written, scores, change, problems) {
  const entries = entriesIn(written);
  if (entries === null) return asText("The requirements");
  const list = listOf("requirements", entries, change);
  const line = (entry, index) => {
    const at = (key) => `requirements.${index}.${key}`;
    const wrong = (key) => problemsAt(problems, at(key));
    const typed = (key, label, more = {}, wide = "") => labelled(at(key), label, h("input", { type: "text", id: `f-${at(key)}`, value: entry[key] ?? "", ...more, on: { change: (event) => list.set(index, { [key]: key === "confidence" ? read(event.target.value) : event.target.value.trim() || null }) } }), wrong(key), wide);
    return h("div", { class: "entry", role: "group", "aria-label": `Requirement ${entry.id ?? index + 1}` },
      h("div", { class: "grid" }, typed("id", "Identifier"), typed("confidence", "Confidence", { placeholder: "0.95", inputmode: "decimal" })),
      h("button", { type: "button", class: "quiet", "aria-label": `Remove the requirement ${entry.id ?? index + 1}`, on: { click: () => list.remove(index) } }, "✕"),
      statistic(entry, index, scores, list, wrong("statistic")),
      h("div", { class: "grid whole" }, typed("where", "Region", { placeholder: "everywhere, or distance_m <= 30" }), typed("text", "In words", { placeholder: "Pedestrians up to 30 m are found." })),
      ["min_visible_pixels", "functions", "min_units"].flatMap((key) => wrong(key)).map((text) => h("p", { class: "problem small" }, text)));
  };
  return [
    entries.length ? entries.map(line) : h("p", { class: "soft small" }, "Each function gets a verdict on each requirement: met, not met or undecided."),
    h("div", { class: "row" }, h("button", { type: "button", on: { click: () => list.add({ id: unused("REQ", entries, "id"), statistic: "share(pacc >= 0.5) >= 95 %" }) } }, "Add a requirement")),
  ].flat();
}

function statistic(entry, index, scores, list, wrong) {
  const place = `requirements.${index}.statistic`;
  const parts = partsOf(entry.statistic);
  if (parts === null) {
    return labelled(place, "Statistic", h("input", { type: "text", id: `f-${place}`, value: entry.statistic ?? "", placeholder: "share(pacc >= 0.5) >= 95 %", on: { change: (event) => list.set(index, { statistic: event.target.value.trim() || null }) } }), wrong, "whole");
  }
  const mark = wrong.length ? { "aria-invalid": "true", "aria-describedby": `f-${place}-problem` } : {};
  const set = (values) => { Object.assign(parts, values); list.set(index, { statistic: statisticOf(parts) }); };
  const select = (key, label, options) => {
    const element = h("select", { id: `f-${place}.${key}`, "aria-label": label, ...mark, on: { change: () => set(key === "kind" ? { kind: element.value, ...BEGUN[element.value] } : { [key]: element.value }) } },
      Object.entries(options).map(([value, text]) => h("option", { value, selected: value === parts[key] }, text)));
    return element;
  };
  const text = (key, label) => h("input", { type: "text", id: `f-${place}.${key}`, "aria-label": label, value: parts[key], ...mark, on: { change: (event) => set({ [key]: event.target.value.trim() }) } });
  const signs = Object.fromEntries(SIGNS.map((one) => [one, { ">=": "≥", "<=": "≤" }[one]]));
  const named = Object.fromEntries([...new Set([...scores.map((one) => one.name), parts.score])].map((one) => [one, one]));
  return h("fieldset", { class: "statistic whole" }, h("legend", {}, "Statistic and bound"),
    select("kind", "Statistic", KINDS), select("score", "Score", named),
    parts.kind === "share" ? [select("condition", "Comparison of the score", signs), text("of", "Value of the score")] : null,
    parts.kind === "quantile" ? [h("span", { class: "soft" }, "at"), text("of", "Order of the quantile")] : null,
    h("span", { class: "soft" }, "is"), select("sign", "Direction of the bound", signs), text("bound", "Bound"),
    wrong.length ? h("p", { class: "problem small", id: `f-${place}-problem` }, wrong.join("; ")) : null);
}
