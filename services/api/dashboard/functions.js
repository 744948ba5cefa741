// Functions under test: kind, origin, workers that run them, and all versions of registered ones.
import { get } from "./api.js";
import { command, h, put, table } from "./dom.js";
import { ago, clock, percent, plural } from "./format.js";
import { poll } from "./poll.js";
import { reaching } from "./role.js";

const KINDS = {
  network: "network of a known architecture", onnx: "ONNX file", huggingface: "Hugging Face model",
  http: "behind HTTP", predictions: "predictions made elsewhere",
};
const CHECKED = {
  logits: "logits equal the original program's", "own format": "VALERIE's own format",
  "opened and run": "opened and run when it was imported", "not opened": "not opened: its engine was not installed at the import",
};
// Rows of the card that show without opening it.
const BRIEF = new Set(["architecture", "engine", "precision", "input size", "reduction", "classes", "judged by"]);

export async function functionsView({ main, signal }) {
  const cards = h("div", { class: "functions" });
  const draw = async () => {
    const functions = await get("/v1/functions", { signal });
    const open = new Set([...cards.querySelectorAll("details[open]")].map((one) => one.dataset.key));
    put(cards, functions, [...byName(functions)].map(([name, versions]) => card(name, versions, open)));
    return 10_000;
  };
  await draw();
  main.replaceChildren(h("h1", {}, "Functions under test"), cards, bring());
  poll(signal, draw);
  return "Functions";
}

function byName(functions) {
  const names = new Map();
  for (const entry of functions) names.set(entry.name, [...(names.get(entry.name) ?? []), entry]);
  return names;
}

function card(name, versions, open) {
  const newest = versions[0]; // versions come newest first
  return h("section", { class: "card function", "aria-label": name },
    h("div", { class: "row" }, h("h2", {}, name), offered(newest)),
    h("p", { class: "small soft" }, [KINDS[newest.kind], newest.version === null ? "installed with the server" : `version ${newest.version}`,
      newest.created_at ? h("span", { title: clock(newest.created_at) }, ` registered ${ago(newest.created_at)}`) : null]
      .filter(Boolean).flatMap((part, i) => (i ? [" · ", part] : [part]))),
    newest.problem ? h("p", { class: "note bad" }, newest.problem) : null,
    h("dl", { class: "facts" }, facts(newest).map(([title, text, mono]) => fact(title, text, mono ? "mono" : null))),
    more(`${name} card`, "The whole card", open, cardFacts(newest)),
    versions.length > 1 ? more(`${name} versions`, plural(versions.length, "version"), open, versionTable(versions)) : null);
}

function offered(one) {
  if (one.problem) return h("span", { class: "chip bad" }, "cannot be used");
  if (one.kind === "predictions") return h("span", { class: "chip" }, "predictions uploaded");
  return one.numeric_classes.length ? h("span", { class: "chip good" }, "offered") : h("span", { class: "chip wait" }, "no living worker");
}

function facts(one) {
  const told = one.provenance;
  const figures = ["person-pacc", "person-precision", "miou"].map((name) => told[`held-out-${name}`]);
  return [
    ["In a spec", one.reference ?? one.name, true],
    ...one.card.filter(([title]) => BRIEF.has(title)).map(([title, text]) => [title[0].toUpperCase() + title.slice(1), text]),
    ["Source", told.source ?? told.file ?? told.program ?? (told["trained-by"] ? `trained by ${told["trained-by"]}` : null)],
    ["Checked", CHECKED[told.checked] ?? told.checked],
    ["Held out: pACC, precision, mIoU", figures.every(Boolean) ? figures.map((rate) => percent(Number(rate))).join(", ") : null],
    ["Licence", told.licence],
    ["Runs as", one.numeric_classes.join(", "), true],
  ].filter(([, text]) => text);
}

function cardFacts(one) {
  return h("dl", { class: "facts" }, one.card.map(([title, text]) => fact(title, text, "small")));
}

function fact(title, text, look) {
  return h("div", { class: text.length > 90 ? "wide" : null }, h("dt", {}, title), h("dd", { class: look }, text));
}

function versionTable(versions) {
  return table(["Version", "In a spec", "Engine", "Source", "Registered"], versions.map((one) => h("tr", {},
    h("th", { scope: "row" }, String(one.version)), h("td", { class: "mono" }, one.reference), h("td", {}, `${one.engine} ${one.precision}`),
    h("td", {}, one.provenance.source ?? one.provenance.file ?? one.provenance["trained-by"] ?? ""), h("td", { title: clock(one.created_at) }, ago(one.created_at)))),
  { caption: "Versions" });
}

function more(key, title, open, content) {
  return h("details", { class: "more", "data-key": key, open: open.has(key) }, h("summary", {}, title), content);
}

function bring() {
  return h("section", { class: "card" }, h("h2", {}, "Import your own"),
    h("p", { class: "under" }, "An ONNX file, a checkpoint of a known architecture or a Hugging Face folder. No program in it is run. It is converted, checked and registered with the settings in my.yaml beside it:"),
    h("p", { class: "under" }, command(reaching("valerie function import my.onnx", { url: true }))),
    h("p", { class: "under small soft" }, "Versions are never overwritten. A name in a spec stands for the newest version when a run starts; the run keeps that version."));
}
