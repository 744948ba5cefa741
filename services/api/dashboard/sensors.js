// The sensors of a spec: one that meters, the paper's fixed exposure, or named ones.
import { h } from "./dom.js";
import { asText, entriesIn, fieldChange, labelled, listOf, problemsAt, read, unused } from "./fields.js";

const KINDS = { usual: "One camera that meters, with a vehicle camera's noise", fixed: "One camera with fixed exposure and without noise, as in the paper", own: "Named sensors" };
const EDITED = new Set(["name", "auto_exposure", "exposure_ev", "gain_db", "noise"]);

// True for the paper's exposure alone.
export const fixedExposure = (written) => {
  const entries = entriesIn(written) ?? [];
  return entries.length === 1 && Object.keys(entries[0]).length === 1 && entries[0].auto_exposure === false;
};

const same = (a, b) => JSON.stringify(a, Object.keys(a ?? {}).sort()) === JSON.stringify(b, Object.keys(b ?? {}).sort());

// `usual` is the setting that a spec without sensors has.
export function sensorFields(written, usual, change, problems) {
  const entries = entriesIn(written);
  if (entries === null) return asText("The sensors");
  const fixed = fixedExposure(written);
  const { shot, read_electrons, full_well_electrons } = usual.noise;
  const vehicle = { shot, read_electrons, full_well_electrons };
  const metering = (name) => ({ name, auto_exposure: true, noise: vehicle });
  const kind = entries.length === 0 ? "usual" : fixed ? "fixed" : "own";
  const starts = { usual: null, fixed: [{ auto_exposure: false }], own: fixed ? [{ name: "fixed", auto_exposure: false }] : [metering("metering")] };
  const list = listOf("sensors", entries, change);
  const choice = h("select", { id: "f-sensors", on: { change: () => change([fieldChange("sensors", starts[choice.value])]) } },
    Object.entries(KINDS).map(([value, label]) => h("option", { value, selected: value === kind }, label)));
  const line = (entry, index) => {
    const at = (key) => `sensors.${index}.${key}`;
    const typed = (key, label, more = {}) => labelled(at(key), label, h("input", { type: "text", id: `f-${at(key)}`, value: entry[key] ?? "", ...more, on: { change: (event) => list.set(index, { [key]: key === "name" ? event.target.value.trim() || null : read(event.target.value) }) } }), problemsAt(problems, at(key)));
    const meters = h("select", { id: `f-${at("auto_exposure")}`, on: { change: () => list.set(index, { auto_exposure: meters.value === "true" }) } },
      h("option", { value: "true", selected: entry.auto_exposure === true }, "metered"), h("option", { value: "false", selected: entry.auto_exposure !== true }, "fixed"));
    const noises = { none: [null, "none"], vehicle: [vehicle, "vehicle camera"], ...(entry.noise && !same(entry.noise, vehicle) ? { own: [entry.noise, "as in the document"] } : {}) };
    const noise = h("select", { id: `f-${at("noise")}`, on: { change: () => list.set(index, { noise: noises[noise.value][0] }) } },
      Object.entries(noises).map(([value, [content, label]]) => h("option", { value, selected: same(entry.noise ?? null, content) }, label)));
    const others = Object.keys(entry).filter((key) => !EDITED.has(key));
    const wrong = others.flatMap((key) => problemsAt(problems, at(key)));
    return h("div", { class: "entry", role: "group", "aria-label": `Sensor ${entry.name ?? index + 1}` },
      h("div", { class: "grid" }, typed("name", "Name", { placeholder: "default" }), labelled(at("auto_exposure"), "Exposure", meters, problemsAt(problems, at("auto_exposure"))),
        typed("exposure_ev", "Offset, EV", { placeholder: "0" }), typed("gain_db", "Gain, dB", { placeholder: "0" }), labelled(at("noise"), "Noise", noise, problemsAt(problems, at("noise")))),
      h("button", { type: "button", class: "quiet", "aria-label": `Remove the sensor ${entry.name ?? index + 1}`, on: { click: () => list.remove(index) } }, "✕"),
      others.length ? h("p", { class: "small soft" }, `Also set in the document: ${others.join(", ")}.`) : null,
      wrong.length ? h("p", { class: "problem small" }, wrong.join("; ")) : null);
  };
  return [
    labelled("sensors", "Camera", choice, problemsAt(problems, "sensors").filter((text) => !entries.some((_, i) => problemsAt(problems, `sensors.${i}`).includes(text)))),
    kind === "own" ? entries.map(line) : null,
    kind === "own" ? h("div", { class: "row" }, h("button", { type: "button", on: { click: () => list.add(metering(unused("sensor", entries, "name"))) } }, "Add a sensor")) : null,
  ].flat().filter(Boolean);
}
