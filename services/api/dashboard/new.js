// A new run: one document as text and as a form, with its plan and pictures of its variants while it is written.
import { get, post, postSpec } from "./api.js";
import { confirm, h, put, toast } from "./dom.js";
import { bytes, count, duration, plural, value, withUnit } from "./format.js";
import { editor } from "./editor.js";
import { specForm } from "./form.js";
import { may, role } from "./role.js";

const TYPING = 350; // a pause in typing, milliseconds
const LOOKING = 700; // a longer one, before pictures are rendered
const SCORES = new Set(["person score", "frame score"]); // sources of what a requirement may bound
export const KEPT = "valerie-draft"; // of this tab and address, so that a look at another page loses nothing
//: Runs that a selection of Explore leads to: title and what it does.
export const CHILDREN = {
  range: ["Refine here", "Draws variants from the ranges of the selected rows."],
  nearby: ["More like these", "Repeats selected variants, each number moved by up to half a step within the selection’s range; listed values stay."],
};

export async function newView({ main, parameters, signal }) {
  const [schema, assets, engines, functions, measures] = await Promise.all(["/v1/schema", "/v1/assets", "/v1/renderers", "/v1/functions", "/v1/measures"].map((path) => get(path, { signal })));
  const catalog = { assets: assets.filter((one) => !one.problem).map((one) => one.name), engines: engines.map((one) => one.name), functions: [...new Set(functions.map((one) => one.name))], scores: measures.filter((one) => SCORES.has(one.source)), sensor: schema.properties.sensors.default[0] };
  const details = new Map(); // of assets, by name
  const assetOf = async (reference) => {
    const name = typeof reference === "string" ? reference : reference?.name;
    if (typeof name !== "string" || !catalog.assets.includes(name)) return null;
    if (!details.has(name)) details.set(name, await get(`/v1/assets/${encodeURIComponent(name)}`, { signal }));
    return details.get(name);
  };

  const parent = parameters.get("parent");
  const origin = parent ?? parameters.get("run");
  const child = CHILDREN[parameters.get("form")];
  let asset = null;
  let draft = null;
  let sure = false; // the plan of this very text has no problem
  let wanted = false; // Submit was clicked before that was known
  let begun; // the document before any edit; null: unknown, since an edited one was kept
  let round = null; // the present round of questions; a newer one ends it
  let pending = []; // changes of the form that the text does not have yet
  let timer = null;

  const problems = h("div", { id: "problems", class: "slot", "aria-live": "polite" });
  const planned = h("div", { "aria-live": "polite" }, h("p", { class: "soft" }, "Planning …"));
  const pictures = previewSection({ signal });
  const submit = h("button", { type: "button", class: "primary", disabled: true, on: { click: () => send() } }, "Submit run");
  const submits = may("POST /v1/runs");
  const priority = h("select", { id: "priority" }, ["low", "normal", "high"].map((one) => h("option", { selected: one === "normal" }, one)));
  const deadline = h("input", { id: "deadline", type: "datetime-local" });
  const text = editor({
    label: "Spec as YAML",
    known: () => ({ schema, names: { ...catalog, cameras: asset?.cameras ?? [], parameters: asset?.parameters ?? [] } }),
    changed: () => { unsure(); round?.abort(); later(); },
  });
  const form = specForm({ catalog, change: (changes) => refresh(changes) });

  const later = () => { clearTimeout(timer); timer = setTimeout(() => refresh(), TYPING); };
  // A click on Submit takes the focus from a field, whose change begins a new plan: the button waits for it instead of losing the click.
  const unsure = () => { sure = wanted = false; submit.setAttribute("aria-busy", "true"); };
  const known = (good) => { sure = good; submit.disabled = !good; submit.removeAttribute("aria-busy"); };
  const kept = `${KEPT} ${location.hash}`;
  const keep = () => (text.text === begun ? sessionStorage.removeItem(kept) : sessionStorage.setItem(kept, text.text));
  const refresh = async (changes = []) => {
    clearTimeout(timer);
    timer = null;
    round?.abort();
    pending.push(...changes);
    const sent = pending.length;
    const mine = round = new AbortController();
    const options = { signal: AbortSignal.any([signal, mine.signal]) };
    unsure();
    try {
      draft = await post("/v1/draft", { text: text.text, changes: pending }, options);
      pending = pending.slice(sent);
      text.text = draft.text;
      if (begun === undefined) begun = draft.text;
      keep();
      asset = await assetOf(draft.fields.asset).catch(() => null);
      const plan = await postSpec("/v1/plan", draft.text, options);
      show([], plan);
      pictures.soon(draft, plan);
      known(true);
      if (wanted) send();
    } catch (error) {
      if (error.name === "AbortError") return;
      pending = [];
      keep();
      known(false);
      show(error.errors?.length ? error.errors : [{ field: "", message: error.message }], null);
    }
  };
  const show = (list, plan) => {
    const wrong = located(list, draft, text);
    if (draft) form.show(draft, asset, new Map(wrong.map((one) => [one.field, one.limit ? `${one.message}; ${one.limit}` : one.message])));
    put(problems, wrong, problemList(wrong, text));
    put(planned, [plan, wrong.length], planSection(plan));
    if (!plan) pictures.stale();
  };
  const send = async () => {
    if (!sure) {
      if (timer) refresh();
      wanted = true;
      return;
    }
    submit.disabled = true;
    try {
      const run = await postSpec(`/v1/runs?${new URLSearchParams({ priority: priority.value, ...(deadline.value && { deadline: new Date(deadline.value).toISOString() }) })}`, text.text, { signal, headers: { "Idempotency-Key": key } });
      sessionStorage.removeItem(kept);
      toast("The run is submitted.");
      location.hash = `#/runs/${run.id}`;
    } catch (error) {
      if (error.name === "AbortError") return;
      submit.disabled = false;
      show(error.errors?.length ? error.errors : [{ field: "", message: error.message }], null);
    }
  };
  // A second click, or one after a lost answer, makes no second run.
  const key = `page-${Array.from(crypto.getRandomValues(new Uint8Array(12)), (one) => one.toString(16).padStart(2, "0")).join("")}`;
  const restart = async () => {
    if (!(await confirm({ title: "Start over?", text: "What is written here is lost.", action: "Start over", danger: true }))) return;
    left.hidden = true;
    begun = undefined;
    await begin(null);
  };
  const begin = async (written) => {
    const source = async () => child ? (await get(`/v1/explore/spec?${parameters}`, { signal })).yaml : origin ? (await get(`/v1/runs/${encodeURIComponent(origin)}/draft?child=${parent !== null}`, { signal })).text : first(catalog);
    text.text = written ?? await source();
    await refresh();
  };
  const written = sessionStorage.getItem(kept);
  const left = h("p", { class: "soft small", hidden: written === null }, `What was written in this tab before. Start over begins ${origin ? "with the run's document" : "a new document"}.`);
  if (written !== null) begun = null;
  const title = child ? child[0] : parent ? "Edit and rerun" : origin ? "Clone a run" : submits ? "New run" : "Plan a run";
  main.replaceChildren(
    h("div", { class: "stack" }, h("p", { class: "crumbs" }, h("a", { href: "#/" }, "Runs"), " / ", origin ? h("a", { href: `#/runs/${origin}`, class: "mono" }, origin) : "new"),
      h("div", { class: "spread" }, h("h1", {}, title), h("div", { class: "row" }, h("button", { type: "button", on: { click: restart } }, "Start over"), submits ? [h("label", { class: "inline", for: "priority" }, "Priority ", priority), h("label", { class: "inline", for: "deadline" }, "Deadline ", deadline), submit] : null)),
      submits ? null : h("p", { class: "note" }, `The token's role is ${role()}: it plans runs, and a runner submits them.`),
      child ? h("p", { class: "soft small" }, `${child[1]} Selected: `, h("code", {}, parameters.get("where") ?? "all rows")) : null,
      left,
      parent ? h("p", { class: "soft small" }, "The new run names this one as its parent. What did not change is not computed again.") : null,
      origin && !parent ? h("p", { class: "soft small" }, "A run of its own that begins with this document. What did not change is not computed again.") : null),
    h("div", { class: "draft" },
      form.element,
      h("div", { class: "drafted" },
        h("section", { class: "card" }, h("div", { class: "head" }, h("h2", {}, h("label", { for: "spec" }, "Document")), h("span", { class: "soft small" }, "Ctrl + Space completes")), text.element, problems),
        h("section", { class: "card", "aria-label": "Plan" }, h("h2", {}, "Plan"), planned),
        may("POST /v1/preview") ? pictures.element : null)));
  await begin(written);
  return title;
}

// A document to begin with.
const first = ({ assets, functions }) => `name: new-run\nasset: ${assets[0] ?? "…"}\nresolution: {width: 960, height: 540}\nfunctions: [${functions.slice(0, 2).join(", ")}]\n`;

// Problems with their lines, which the editor marks.
export function located(list, draft, text) {
  const wrong = list.map((one) => ({ ...one, line: lineOf(one, draft) }));
  text.mark(new Map(wrong.filter((one) => one.line).map((one) => [one.line, one.message])));
  return wrong;
}

export const problemList = (wrong, text) => (wrong.length ? h("ul", { class: "note bad problems" }, wrong.map((one) => h("li", {},
  one.line ? h("button", { type: "button", class: "link", on: { click: () => text.goTo(one.line) } }, `Line ${one.line}`) : null,
  one.field ? h("code", {}, one.field) : null, ` ${one.message}`, one.limit ? h("span", { class: "soft" }, ` · ${one.limit}`) : null))) : null);

// The line of a problem: of the longest place that leads to its field, or the one that its message names.
function lineOf({ field, message }, draft) {
  const named = /line (\d+)/.exec(message);
  if (named) return Number(named[1]);
  for (let place = field; place; place = place.includes(".") ? place.slice(0, place.lastIndexOf(".")) : "") {
    if (draft?.lines[place]) return draft.lines[place];
  }
  return null;
}

export function planSection(plan) {
  if (!plan) return h("p", { class: "soft" }, "The plan appears when the document has no problem.");
  const about = plan.estimated ? "about " : "";
  const rejected = Object.entries(plan.rejected).sort((a, b) => b[1] - a[1]);
  const facts = [
    ["Variants", `${about}${count(plan.accepted)}${plan.accepted < plan.variants ? ` of ${count(plan.variants)}` : ""}`], ["Frames", `${about}${count(plan.frames)}`], ["Evaluations", `${about}${count(plan.evaluations)}`],
    ["Time on one core", `about ${duration(Math.max(1, Math.round(plan.cpu_seconds)))}`], ["Disk", `about ${bytes(plan.bytes)}`],
  ];
  return [
    h("dl", { class: "facts plan" }, facts.map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", { class: "number" }, text)))),
    plan.warnings.map((one) => h("p", { class: "note wait small" }, one)),
    rejected.length ? h("details", { class: "more" }, h("summary", {}, `${plural(plan.variants - plan.accepted, "variant")} rejected`), h("ul", {}, rejected.slice(0, 20).map(([reason, n]) => h("li", {}, reason, h("span", { class: "soft number" }, ` · ${count(n)}`))))) : null,
    plan.notes.length ? h("details", { class: "more" }, h("summary", {}, plural(plan.notes.length, "assumption")), h("ul", {}, plan.notes.map((one) => h("li", {}, one)))) : null,
    h("p", { class: "small soft under" }, `Costs: ${plan.cost_basis}. What is stored already is not computed again.`),
  ];
}

// The first, the last and a random variant, rendered small.
function previewSection({ signal }) {
  const figures = h("div", { class: "previews", "aria-busy": "false" });
  const state = h("p", { class: "small soft", role: "status" });
  const lack = h("div", { class: "slot" }); // why it is not the spec's engine
  const camera = h("select", { id: "preview-camera", on: { change: () => ask() } });
  const another = h("button", { type: "button", on: { click: () => { chance = Math.random(); ask(); } } }, "Another random variant");
  const element = h("section", { class: "card", "aria-label": "Preview" }, h("div", { class: "head" }, h("h2", {}, "Preview"), h("label", { class: "inline", for: "preview-camera" }, "Camera ", camera), another), figures, lack, state);
  let chance = Math.random();
  let timer = null;
  let wanted = null; // the document and its plan
  let asking = false;
  let cameras = null;

  const ask = async () => {
    clearTimeout(timer);
    if (!wanted || asking || signal.aborted || !may("POST /v1/preview")) return; // the present request asks again when it ends
    asking = true;
    const { text, plan, varied, engine } = wanted;
    const looked = `${text} ${camera.value} ${chance}`;
    const indexes = [...new Set([0, Math.floor(chance * plan.variants), plan.variants - 1])];
    figures.setAttribute("aria-busy", "true");
    state.textContent = figures.children.length ? `Rendering by ${engine} …` : `Rendering by ${engine} … The first picture of an asset takes longest.`;
    try {
      const query = new URLSearchParams([...indexes.map((one) => ["variant", one]), ["accepted", true], ...(camera.value ? [["camera", camera.value]] : [])]);
      const answer = await postSpec(`/v1/preview?${query}`, text, { signal });
      figures.replaceChildren(...answer.variants.map((one) => figure(one, plan.units, varied)));
      put(lack, [answer.problem, engine], answer.problem ? h("p", { class: "note wait small" }, `The engine ${engine} does not render here: ${answer.problem}. These pictures are by ${answer.engine}, so light and materials differ from those of the run.`) : null);
      const drafted = Object.entries(answer.draft).map(([name, one]) => `${name} ${one}`).join(", ");
      state.textContent = `Rendered small by the engine ${answer.engine}${drafted ? ` (${drafted})` : ""}, through the first sensor.`;
    } catch (error) {
      if (error.name === "AbortError") return;
      state.textContent = error.message;
      if (error.again) timer = setTimeout(ask, error.again * 1000);
    } finally {
      asking = false;
      figures.setAttribute("aria-busy", "false");
      if (wanted && looked !== `${wanted.text} ${camera.value} ${chance}`) ask();
    }
  };
  return {
    element,
    soon({ text, fields, vary, several_blocks: several }, plan) {
      wanted = { text, plan, engine: fields.renderer?.name ?? fields.renderer ?? "raster", varied: several ? null : new Set(vary.map((one) => one.document.parameter)) };
      const names = plan.cameras.join(" ");
      if (names !== cameras) {
        cameras = names;
        const before = camera.value;
        camera.replaceChildren(...plan.cameras.map((one) => h("option", { selected: one === before }, one)));
      }
      clearTimeout(timer);
      timer = setTimeout(ask, LOOKING);
    },
    stale() { wanted = null; clearTimeout(timer); figures.setAttribute("aria-busy", "true"); },
  };
}

// A picture with the values of the varied parameters, or of all where ``varied`` is null.
function figure({ variant, picture }, units, varied) {
  const values = Object.entries(variant.values).filter(([name]) => varied?.has(name) ?? true).map(([name, one]) => `${name} ${withUnit(value(one), units[name])}`).join(", ");
  const image = picture ? h("img", { alt: `Variant ${variant.index}: ${values}` }) : h("div", { class: "rejected small" }, `rejected: ${variant.rejection}`);
  if (picture) {
    const address = URL.createObjectURL(new Blob([Uint8Array.from(atob(picture), (one) => one.charCodeAt(0))], { type: "image/png" }));
    image.addEventListener("load", () => URL.revokeObjectURL(address));
    image.src = address;
  }
  return h("figure", {}, image, h("figcaption", { class: "small soft" }, h("strong", {}, `Variant ${count(variant.index)}`), values ? ` · ${values}` : ""));
}
