// A spec as a form: general fields, and each of the asset's parameters varied, constant or left alone.
import { limits, reach } from "./completion.js";
import { h, put, toast } from "./dom.js";
import { fieldChange, labelled, problemsAt, read } from "./fields.js";
import { short } from "./format.js";
import { LIGHTS, lightTitle } from "./light.js";
import { requirementFields } from "./requirements.js";
import { fixedExposure, sensorFields } from "./sensors.js";

const DESIGNS = ["grid", "sobol", "latin_hypercube", "halton", "random"];
const DRAWN = new Set(["sobol", "latin_hypercube", "halton", "random"]);
const WAYS = { HOMOGENEOUS: "Steps", UNIFORM: "Range", GAUSSIAN: "Normal", CHOICE: "Choices", constant: "Constant" };
const INPUTS = {
  HOMOGENEOUS: [["minimum", "from"], ["maximum", "to"], ["step", "step"]],
  UNIFORM: [["minimum", "from"], ["maximum", "to"], ["count", "count"]],
  GAUSSIAN: [["mean", "mean"], ["standard_deviation", "sigma"], ["count", "count"]],
};

const names = (parameter) => new Set([parameter.name, parameter.path]);

// The selected range of a field with text; null of any other element.
const textRange = (field) => (field?.selectionStart == null ? null : [field.selectionStart, field.selectionEnd]);

export function specForm({ change, catalog }) {
  const general = h("div", { class: "fields" });
  const rows = h("div", { class: "parameters" });
  const found = h("ul", { class: "found", "aria-label": "Parameters of the asset" });
  const search = h("input", { type: "search", id: "parameter-search", placeholder: "person-1, sun, rain …", on: { input: () => offer() } });
  const blocks = h("p", { class: "note", hidden: true }, "This spec has several blocks. Its parameters are edited as text.");
  const adding = h("div", { class: "stack adding" }, h("label", { for: "parameter-search" }, "Add a parameter"), search, found);
  const light = h("div", {});
  const sensors = h("div", { class: "fields" });
  const requirements = h("div", { class: "fields" });
  const element = h("div", { class: "spec-form" },
    h("section", { class: "card" }, h("h2", {}, "Run"), general),
    h("section", { class: "card" }, h("div", { class: "head" }, h("h2", {}, "Parameters"), light), blocks, rows, adding),
    h("section", { class: "card" }, h("h2", {}, "Sensors"), sensors),
    h("section", { class: "card" }, h("h2", {}, "Requirements"), requirements));
  let shown = null; // the draft and the asset
  let edited = null; // the field in which somebody types; it must not be replaced meanwhile
  let later = null; // what is to be shown when that ends
  let used = new Set();
  const day = {}; // what Dusk or Night took away, so that Day brings it back

  const offer = () => {
    const text = search.value.trim().toLowerCase();
    const all = shown?.asset?.parameters ?? [];
    const fits = text ? all.filter((one) => !used.has(one.path) && `${one.name} ${one.description}`.toLowerCase().includes(text)).slice(0, 12) : [];
    found.replaceChildren(...fits.map((one) => h("li", {},
      h("button", { type: "button", on: { click: () => add(one) } }, h("strong", {}, one.name), h("span", { class: "soft small" }, limits(one))))));
  };
  const add = (parameter) => {
    search.value = "";
    offer();
    change([{ kind: "parameter", parameter: parameter.name, ...begun(parameter, parameter.choices.length || parameter.type === "BOOL" ? "CHOICE" : "HOMOGENEOUS") }]);
  };

  element.addEventListener("input", ({ target }) => { if (target.type === "text" || target.type === "textarea") edited = target; });
  element.addEventListener("change", () => { edited = later = null; }, { capture: true }); // its answer comes
  element.addEventListener("focusout", () => { edited = null; setTimeout(() => { if (later) form.show(...later); }); });

  const form = {
    element,
    // The draft, the asset that it names (null if unknown), and problems by place.
    show(draft, asset, problems) {
      later = edited ? [draft, asset, problems] : null;
      if (later) return;
      shown = { draft, asset };
      const focused = document.activeElement;
      const range = textRange(focused);
      const whole = range?.[0] === 0 && range[1] === focused.value.length;
      const { fields } = draft;
      put(general, [fields, asset?.digest, catalog, [...problems]], generalFields(fields, asset, catalog, change, problems));
      put(sensors, [fields.sensors, [...problems]], sensorFields(fields.sensors, catalog.sensor, change, problems));
      put(requirements, [fields.requirements, [...problems]], requirementFields(fields.requirements, catalog.scores, change, problems));
      const entries = draft.several_blocks ? [] : entriesOf(draft, asset);
      used = new Set(entries.map((one) => one.parameter?.path));
      put(light, [entries, fields.sensors, fields.points, asset?.digest], draft.several_blocks ? null : lightButtons(fields, asset, entries, change, day));
      put(rows, [entries, [...problems]], entries.map((one) => parameterRow(one, change, problems)));
      rows.hidden = adding.hidden = draft.several_blocks;
      blocks.hidden = !draft.several_blocks;
      offer();
      if (!focused?.id || document.activeElement === focused) return;
      const again = element.querySelector(`#${CSS.escape(focused.id)}`); // the field that replaces it
      again?.focus({ preventScroll: true });
      if (range && textRange(again)) again.setSelectionRange(...(whole ? [0, again.value.length] : range)); // what is typed next replaces it
    },
  };
  return form;
}

// Varied and constant parameters, with what the asset declares of each.
function entriesOf(draft, asset) {
  const declared = draft.fields.parameters ?? [];
  const own = new Map((Array.isArray(declared) ? declared.map((one) => (Array.isArray(one) ? [one[0], one[1]] : [one.name, one.path ?? one.scene_graph_ref])) : Object.entries(declared).map(([name, one]) => [name, one?.path ?? one?.scene_graph_ref])));
  const of = (name) => asset?.parameters.find((one) => names(one).has(name) || names(one).has(own.get(name)));
  const varied = draft.vary.map(({ place, document }) => ({ name: document.parameter, place, way: document.distribution, document, parameter: of(document.parameter) }));
  const constants = Object.entries(draft.fields.constants ?? {}).map(([name, value]) => ({ name, place: `constants.${name}`, way: "constant", document: { value }, parameter: of(name) }));
  return [...varied, ...constants];
}

// Buttons that make the sun's elevation constant, if the asset has one sun. A fixed exposure is black without the day.
function lightButtons({ sensors, points = [] }, asset, entries, change, day) {
  const suns = (asset?.parameters ?? []).filter((one) => /\bsun\b.*\.elevation$/.test(one.path));
  if (suns.length !== 1) return null;
  const [sun] = suns, entry = entries.find((one) => one.parameter === sun);
  const at = entry?.way === "constant" ? Number.parseFloat(entry.document.value) : entry ? NaN : sun.default;
  // Points override a constant.
  const listed = points.flatMap((point) => Object.entries(point).filter(([name]) => names(sun).has(name)).map(([, value]) => Number.parseFloat(value)));
  const treat = (treatment) => ({ kind: "parameter", parameter: entry?.name ?? sun.name, ...treatment });
  const present = !entry ? {} : entry.way === "constant" ? { constant: entry.document.value } : { vary: { ...entry.document, parameter: undefined } };
  const set = ({ usual, low }) => {
    if (low === LIGHTS.Day.low) {
      change([treat(day.sun ?? { constant: usual }), ...(day.sensors && !sensors ? [fieldChange("sensors", day.sensors)] : [])]);
      day.sun = day.sensors = null;
      return;
    }
    if (!(at < LIGHTS.Day.low)) day.sun = present;
    const fixed = fixedExposure(sensors);
    if (fixed) {
      day.sensors = sensors;
      toast("The camera meters now: with a fixed exposure, pictures without daylight are black. Day brings the fixed exposure back.");
    }
    change([treat({ constant: usual }), ...(fixed ? [fieldChange("sensors", null)] : [])]);
  };
  return h("div", { class: "segments", role: "group", "aria-label": "Light" }, Object.entries(LIGHTS).filter(([, { usual }]) => usual >= (sun.minimum ?? usual) && usual <= (sun.maximum ?? usual)).map(([label, range]) =>
    h("button", { type: "button", disabled: listed.length > 0, title: listed.length ? `The points of this document set ${short(sun.name)}; edit it as text.` : `${short(sun.name)} ${range.usual}° (${lightTitle(range)})${range.low < LIGHTS.Day.low ? "; the camera meters" : ""}`, "aria-pressed": String((listed.length ? listed : [at]).every((one) => one >= range.low && one < range.high)), on: { click: () => set(range) } }, label)));
}

// A first distribution of a parameter, with the ends of the one before.
function begun(parameter, way, { minimum, maximum } = {}) {
  if (way === "constant") return { constant: parameter.default };
  const usual = reach(parameter);
  const { step } = usual, first = minimum ?? usual.first, last = maximum ?? usual.last;
  if (way === "HOMOGENEOUS") return { vary: { distribution: way, minimum: first, maximum: last, step } };
  if (way === "UNIFORM") return { vary: { distribution: way, minimum: first, maximum: last, count: 5 } };
  if (way === "GAUSSIAN") return { vary: { distribution: way, mean: parameter.default, standard_deviation: step, count: 5 } };
  return { vary: { distribution: way, values: parameter.type === "BOOL" ? [true, false] : parameter.choices.length ? parameter.choices : [first, last] } };
}

function parameterRow({ name, place, way, document: entry, parameter }, change, problems) {
  const id = (part) => `p-${name}-${part}`;
  const set = (treatment) => change([{ kind: "parameter", parameter: name, ...treatment }]);
  // Kept in the entry, too: the next change may come before the answer to this one.
  const vary = (more) => set({ vary: { ...Object.assign(entry, more), parameter: undefined } });
  const wrong = problemsAt(problems, place);
  const mark = wrong.length ? { "aria-invalid": "true", "aria-describedby": id("problem") } : {};
  const input = (key, label, value, take, more = {}) => h("label", { for: id(key) }, label,
    h("input", { type: "text", id: id(key), value: value ?? "", ...mark, ...more, on: { change: (event) => take(read(event.target.value)) } }));
  const choices = parameter?.type === "BOOL" ? [true, false] : parameter?.choices ?? [];
  const ways = choices.length ? ["CHOICE", "constant"] : Object.keys(WAYS);
  let inputs;
  if (INPUTS[way]) inputs = INPUTS[way].map(([key, label]) => input(key, label, entry[key], (value) => vary({ [key]: value })));
  else if (way === "CHOICE" && choices.length) {
    inputs = h("fieldset", {}, h("legend", { class: "hidden" }, `Choices of ${name}`), choices.map((one) => h("label", { class: "inline" },
      h("input", { type: "checkbox", id: id(one), checked: (entry.values ?? []).includes(one), on: { change: (event) => vary({ values: choices.filter((other) => (other === one ? event.target.checked : (entry.values ?? []).includes(other))) }) } }), String(one))));
  } else if (way === "CHOICE") inputs = input("values", "values", (entry.values ?? []).join(", "), () => {}, { on: { change: (event) => vary({ values: event.target.value.split(",").map(read).filter((one) => one !== null) }) } });
  else if (choices.length) inputs = h("label", { for: id("value") }, "value", h("select", { id: id("value"), ...mark, on: { change: (event) => set({ constant: choices[event.target.selectedIndex] }) } }, choices.map((one) => h("option", { selected: one === entry.value }, String(one)))));
  else inputs = input("value", "value", entry.value, (value) => set({ constant: value }));
  return h("div", { class: `parameter${wrong.length ? " wrong" : ""}`, role: "group", "aria-label": name },
    h("div", { class: "parameter-name" }, h("strong", {}, short(name)), parameter ? h("span", { class: "soft small", title: parameter.description || null }, choices.length ? parameter.type.toLowerCase() : limits(parameter)) : null),
    h("label", { for: id("way") }, h("span", { class: "hidden" }, `How ${name} is treated`),
      h("select", { id: id("way"), on: { change: (event) => set(begun(parameter ?? { default: 0, choices: [] }, event.target.value, entry)) } }, ways.map((one) => h("option", { value: one, selected: one === way }, WAYS[one])))),
    h("div", { class: "values" }, inputs),
    h("button", { type: "button", class: "quiet", "aria-label": `Leave ${name} at its default`, on: { click: () => set({}) } }, "✕"),
    wrong.length ? h("p", { class: "problem small", id: id("problem") }, wrong.join("; ")) : null);
}

function generalFields(fields, asset, catalog, change, problems) {
  const field = (name, label, control) => labelled(name, label, control, problemsAt(problems, name));
  const text = (name, more = {}) => h("input", { type: "text", id: `f-${name}`, value: fields[name] ?? "", ...more, on: { change: (event) => change([fieldChange(name, more.inputmode ? read(event.target.value) : event.target.value || null)]) } });
  const select = (name, options, usual) => {
    const value = typeof fields[name] === "object" && fields[name] ? fields[name].name : fields[name] ?? usual;
    const written = typeof fields[name] === "object" && fields[name] !== null;
    return h("select", { id: `f-${name}`, disabled: written, title: written ? "has arguments: edited as text" : null, on: { change: (event) => change([fieldChange(name, event.target.value)]) } },
      [...new Set([value, ...options].filter(Boolean))].map((one) => h("option", { value: one, selected: one === value }, one)));
  };
  const several = (name, options, chosen, whole) => h("fieldset", { id: `f-${name}`, class: "several" }, h("legend", {}, name[0].toUpperCase() + name.slice(1)), options.map((one) => h("label", { class: "inline" },
    h("input", { type: "checkbox", id: `f-${name}-${one}`, checked: chosen.includes(one), on: { change: (event) => {
      const next = options.filter((other) => (other === one ? event.target.checked : chosen.includes(other)));
      chosen = next;
      change([fieldChange(name, whole && next.length === options.length ? null : next)]);
    } } }), one)), problemsAt(problems, name).map((wrong) => h("p", { class: "problem small" }, wrong)));
  const lines = (name, more) => h("textarea", { id: `f-${name}`, rows: 2, spellcheck: "false", ...more, on: { change: (event) => {
    const written = event.target.value.split("\n").map((one) => one.trim()).filter(Boolean);
    change([fieldChange(name, written.length ? written : null)]);
  } } }, [fields[name] ?? []].flat().join("\n"));
  const cameras = asset?.cameras ?? [];
  const functions = Array.isArray(fields.functions) ? fields.functions : [];
  const size = { width: 960, height: 540, ...(typeof fields.resolution === "object" ? fields.resolution : {}) };
  const pixels = (name) => field(`resolution.${name}`, name === "width" ? "Width" : "Height", h("input", { type: "text", inputmode: "numeric", id: `f-resolution.${name}`, value: size[name],
    on: { change: (event) => change([fieldChange("resolution", Object.assign(size, { [name]: read(event.target.value) }))]) } }));
  const design = fields.design ?? "grid";
  return [
    h("div", { class: "grid" }, field("name", "Name", text("name")), field("asset", "Asset", select("asset", catalog.assets)), field("renderer", "Render engine", select("renderer", catalog.engines, "raster"))),
    h("div", { class: "grid" }, pixels("width"), pixels("height"),
      field("design", "Design", select("design", DESIGNS, "grid")),
      DRAWN.has(design) || fields.count ? field("count", "Variants", text("count", { inputmode: "numeric" })) : null,
      field("seed", "Seed", text("seed", { inputmode: "numeric", placeholder: "0" }))),
    cameras.length ? several("cameras", cameras, fields.cameras ?? cameras, true) : null,
    catalog.functions.length || functions.length ? several("functions", [...new Set([...catalog.functions, ...functions])], functions) : null,
    field("constraints", "Constraints, one to a line", lines("constraints", { placeholder: "person-1.pos.y < 30" })),
  ].filter(Boolean);
}
