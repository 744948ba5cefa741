// The verdicts on the requirements, the table of the paper's section 6.2, and the findings.
import { h, table } from "./dom.js";
import { count, percent, plural } from "./format.js";

const CANDIDATES = 5;

const ends = (one) => (one ? `[${(100 * one.low).toFixed(1)} – ${(100 * one.high).toFixed(1)}]` : "");
// A refusal has a reason and no ends; then the spread over places is shown.
const interval = (one, spread) => ends(one?.low === undefined ? spread : one);
const undefinedText = (reasons) => Object.entries(reasons).map(([reason, n]) => `${count(n)} ${reason}`).join(", ");

export function summarySection({ verdicts, judged: sentences, summary, findings, certainty, searched }, marked) {
  const judged = verdictList(verdicts, sentences);
  const warnings = warningNotes(summary);
  if (!summary.rows.length) return h("section", { class: "card" }, judged, h("h2", {}, "Summary"), warnings, h("p", { class: "soft" }, "No person was evaluated in this run."));
  const several = new Set(summary.rows.map((row) => row.sensor)).size > 1;
  const head = [
    "Function", ...(several ? ["Sensor"] : []), "Pedestrian",
    { text: "mean pACC", class: "right", title: "mean over all persons in frames with a defined pACC" }, { text: "min", class: "right" }, { text: "max", class: "right" },
    { text: "pooled pACC", class: "right", title: "from the pixels of all frames together" },
    { text: "mean precision", class: "right", title: "mean over the frames; false positives belong to no person" }, { text: "mean IoU", class: "right", title: "mean over the frames" },
    { text: `Detected ≥ ${summary.threshold}`, class: "right", title: "share of persons with a pACC of at least the threshold" },
    { text: "Frames", class: "right" }, "Undefined",
  ];
  let last = null;
  const rows = summary.rows.map((row) => {
    const first = row.function !== last;
    last = row.function;
    return h("tr", { class: row.character === "all" ? "all" : null },
      h("th", { scope: "row" }, first ? row.function : h("span", { class: "ditto" }, row.function)), several ? h("td", {}, row.sensor) : null,
      h("td", {}, row.character === "all" ? "all together" : row.character),
      h("td", { class: "right" }, h("strong", {}, percent(row.pacc_mean)), h("div", { class: "small soft" }, interval(row.pacc_mean_interval, row.pacc_mean_spread))),
      h("td", { class: "right" }, percent(row.pacc_min)), h("td", { class: "right" }, percent(row.pacc_max)), h("td", { class: "right" }, percent(row.pacc_pooled)),
      h("td", { class: "right" }, percent(row.precision_mean)), h("td", { class: "right" }, percent(row.iou_mean)),
      h("td", { class: "right" }, percent(row.detection_rate), h("div", { class: "small soft" }, interval(row.detection_interval, row.detection_spread))),
      h("td", { class: "right" }, count(row.frames)),
      h("td", { class: "small soft" }, undefinedText(row.undefined) || "none"));
  });
  const occluded = summary.occlusion.find((one) => one.character === "all") ?? summary.occlusion[0];
  return h("section", { class: "card" }, judged, h("h2", {}, "Summary"), warnings,
    table(head, rows, { caption: "Summary per function and pedestrian" }),
    h("p", { class: "small soft under" }, "pACC is the share of a person’s pixels that a function calls person. Calling everything person would score 100 %, so compare precision and IoU. ", certainty.join(" "),
      occluded?.persons ? ` ${percent(occluded.occluded / occluded.persons, 0)} of the persons are more than 5 % occluded.` : ""),
    list("Findings", findings.items, 1, marked), list("Candidates, not confirmed", findings.candidates.slice(0, CANDIDATES), findings.items.length + 1, marked),
    findings.candidates.length > CANDIDATES ? h("p", { class: "small soft under" }, `The report has ${plural(findings.candidates.length - CANDIDATES, "more candidate")}.`) : null,
    h("p", { class: "small soft under" }, searched),
    findings.notes.map((sentence) => h("p", { class: "small soft under" }, sentence)));
}

export const warningNotes = (summary) => summary.warnings.map((sentence) => h("p", { class: "note bad" }, h("span", {}, linked(sentence))));

const FRAME = /([\w-]+(?:\.\d+){3})/;
const linked = (sentence) => sentence.split(FRAME).map((part, k) => (k % 2 ? h("a", { class: "mono", href: `#/frames/${part}` }, part) : part));

// The look of an outcome.
const OUTCOMES = { met: "good", "not met": "bad", undecided: "wait" };

function verdictList(verdicts, sentences) {
  if (!verdicts.length) return null;
  const numbers = Object.keys(OUTCOMES).map((outcome) => [verdicts.filter((one) => one.outcome === outcome).length, outcome]).filter(([n]) => n);
  return h("div", { class: "verdicts" }, h("h2", {}, "Requirements ", h("span", { class: "small soft" }, numbers.map(([n, outcome]) => `${count(n)} ${outcome}`).join(", "))), h("ul", {}, verdicts.map((one, k) => h("li", {},
    h("span", { class: `chip ${OUTCOMES[one.outcome]}` }, one.outcome), h("strong", {}, ` ${one.id} · ${one.function}`), one.text ? `: ${one.text}` : "",
    h("div", { class: "small soft" }, sentences[k])))));
}

const list = (title, findings, start, marked) => (findings.length
  ? h("div", { class: "findings" }, h("h3", {}, title), h("ol", { start }, findings.map((one) => h("li", {}, one.sentence, marked(one.sentence))))) : null);
