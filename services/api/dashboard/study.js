// One study: what is known, what it cost, what comes next, and its batches.
import { get, post } from "./api.js";
import { confirm, h, put, table, toast } from "./dom.js";
import { NONE, ago, bytes, clock, count, duration, heading, plural, words } from "./format.js";
import { poll } from "./poll.js";
import { may, role } from "./role.js";
import { fileLink } from "./run.js";
import { bar } from "./runs.js";
import { measured, stateChip } from "./studies.js";

const MOST = 1000; // variants of a batch
const OUTCOMES = [["failed", "Fail"], ["passed", "Pass"], ["undefined", "Undefined"]];
const STOP = {
  title: "Stop this study?", action: "Stop the study", danger: true,
  text: "Its open runs are cancelled, and its result is what is known now. A stopped study cannot be continued.",
};

// Someone else accepted the batch in the meantime; the next poll shows it.
const gone = (error) => { if (error.status === 409) return null; throw error; };

export async function studyView({ main, key, signal }) {
  const path = `/v1/studies/${key}`;
  const [head, reason, result, budget, next, batches, source] = Array.from({ length: 7 }, () => h("div", { class: "slot" }));
  let proposal = null; // the price of the batch that waits; asked for once per batch
  let progress = new Map(); // of open runs, by id

  const act = async (address, done) => {
    try {
      await post(address);
      toast(done);
    } catch (error) {
      toast(error.message);
    }
    again();
  };
  const stop = async () => { if (await confirm(STOP)) await act(`${path}/stop`, "The study is stopped."); };
  const setMode = (byHand) => act(`${path}/mode?by_hand=${byHand}`, byHand ? "You accept each batch from now on." : "Batches are accepted as they are proposed.");

  const draw = async () => {
    const study = await get(path, { signal });
    const waiting = study.state === "running" ? study.batches.find((batch) => !batch.accepted_at) : undefined;
    if (!waiting) proposal = null;
    else if (proposal?.number !== waiting.number) proposal = await get(`${path}/next`, { signal }).catch(gone);
    const open = study.batches.filter((batch) => batch.run_id && !batch.outcomes).map((batch) => batch.run_id);
    // A run may have been deleted; then the study says so itself.
    progress = new Map(await Promise.all(open.map(async (id) => [id, await get(`/v1/runs/${id}/progress`, { signal }).catch(() => null)])));

    const going = !study.finished_at;
    put(head, [study.state, study.reason, study.by_hand, study.batches.map((batch) => batch.outcomes !== null), ago(study.created_at)], h("div", { class: "spread" },
      h("div", { class: "stack" },
        h("div", { class: "row" }, h("h1", {}, study.name), stateChip(study)),
        h("p", {}, h("strong", {}, study.question), " ", measured(study)),
        h("p", { class: "soft small", title: clock(study.created_at) }, `Begun ${ago(study.created_at)}`, study.finished_at ? ` · ended ${ago(study.finished_at)}` : "")),
      h("div", { class: "row" },
        going && may("POST /v1/studies/{study_id}/mode") ? modes(study, setMode) : null,
        study.state === "paused" && may("POST /v1/studies/{study_id}/resume") ? h("button", { type: "button", class: "primary", on: { click: () => act(`${path}/resume`, "The study goes on.") } }, "Resume") : null,
        explored(study), fileLink("Report", `${path}/report`, `${key}-study.html`, true),
        going && may("POST /v1/studies/{study_id}/stop") ? h("button", { type: "button", class: "danger", on: { click: stop } }, "Stop") : null)));
    put(reason, [study.state, study.reason], study.reason && !waiting ? h("p", { class: `note ${study.state === "paused" ? "wait" : ""}` }, `${heading(words(study.state))}: ${study.reason}`) : null);
    put(result, [study.result, study.outlook, study.batches.length], known(study));
    put(budget, [study.left, study.batches.map((batch) => batch.cpu_seconds)], spent(study));
    put(next, [waiting?.number, proposal?.number], waiting && proposal ? proposed(study, waiting, proposal, (size) => act(`${path}/accept${size}`, `Batch ${waiting.number + 1} is accepted.`)) : null);
    put(batches, [study.batches, [...progress]], history(study, progress));
    put(source, study.document, h("details", { class: "card spec" }, h("summary", {}, h("h2", {}, "Document")), h("pre", { tabindex: "0" }, study.document)));
    return study.state === "running" ? 2000 : 10_000;
  };
  await draw();
  main.replaceChildren(
    h("div", { class: "stack" }, h("p", { class: "crumbs" }, h("a", { href: "#/studies" }, "Studies"), " / ", h("span", { class: "mono" }, key)), head),
    reason, next, h("div", { class: "answer" }, result, budget), batches, source);
  const again = poll(signal, draw);
  return head.querySelector("h1").textContent;
}

function modes({ by_hand: byHand }, set) {
  const choice = (text, value) => h("button", { type: "button", "aria-pressed": String(byHand === value), on: { click: () => { if (byHand !== value) set(value); } } }, text);
  return h("div", { class: "segments", role: "group", "aria-label": "Who accepts batches" }, choice("Automatic", false), choice("By hand", true));
}

function explored({ batches }) {
  const runs = batches.filter((batch) => batch.outcomes && batch.run_id).map((batch) => batch.run_id);
  return runs.length ? h("a", { class: "button", href: `#/explore?runs=${runs.join(",")}` }, "Explore") : null;
}

function known({ result, outlook, batches, finished_at: ended }) {
  if (!result) return h("section", { class: "card" }, h("h2", {}, "Result"), h("p", { class: "soft" }, ended ? "The study ended without a result." : "No result yet."));
  const numbers = Object.entries(result.numbers).map(([name, value]) => [heading(name.replaceAll("_", " ")), figure(value)]).filter(([, text]) => text);
  return h("section", { class: "card" }, h("h2", {}, ended ? "Result" : "Result so far"),
    h("div", { class: "stack sentences" }, result.sentences.map((sentence, i) => h("p", {}, i ? sentence : h("strong", {}, sentence))), outlook ? h("p", {}, outlook) : null),
    numbers.length ? h("details", { class: "more" }, h("summary", {}, "Numbers"), h("dl", { class: "facts" }, numbers.map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", { class: "number" }, text))))) : null,
    h("p", { class: "small soft under" }, `Rests on ${count(result.batches)} of ${plural(batches.length, "batch", "batches")}.`));
}

// A number, a text, or an estimate with its interval; null for what has other parts.
function figure(value) {
  if (typeof value === "number") return Number(value.toPrecision(4)).toLocaleString("en", { maximumSignificantDigits: 4 });
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value === "string") return value;
  if (typeof value?.estimate !== "number") return null;
  const ends = typeof value.low === "number" ? ` (${figure(value.low)} to ${figure(value.high)})` : "";
  return `${figure(value.estimate)}${ends}`;
}

function spent({ budget, left, batches }) {
  const used = batches.reduce((sum, batch) => sum + batch.legal, 0);
  const seconds = batches.reduce((sum, batch) => sum + (batch.cpu_seconds ?? 0), 0);
  const limit = budget.cpu_hours === null ? null : budget.cpu_hours * 3600;
  const part = (title, amount, total, text, rest) => h("div", { class: "stack" }, h("h3", {}, title), total === null ? null : bar(Math.min(amount, total), 0, total, `${title} of the budget`),
    h("p", { class: "small number" }, h("strong", {}, text), rest ? h("span", { class: "soft" }, rest) : null));
  return h("section", { class: "card budget" }, h("h2", {}, "Budget"),
    part("Variants", used, budget.variants, count(used), ` of ${count(budget.variants)} proposed, ${count(left)} left`),
    part("CPU time", seconds, limit, duration(Math.round(seconds)), limit === null ? " spent, without a limit" : ` of ${duration(Math.round(limit))} spent, ${duration(Math.round(Math.max(limit - seconds, 0)))} left`),
    budget.deadline ? h("p", { class: "small" }, `Proposes until ${clock(budget.deadline)}.`) : null);
}

function proposed(study, batch, { reason, legal, rejected, plan }, accept) {
  const most = Math.min(MOST, study.left + batch.legal);
  const variants = legal + rejected;
  const number = h("input", { type: "number", id: "count", min: 1, max: most, step: 1, value: variants, required: true });
  const submit = (event) => { event.preventDefault(); if (number.reportValidity()) accept(number.valueAsNumber === variants ? "" : `?count=${number.valueAsNumber}`); };
  return h("section", { class: "card proposal" }, h("h2", {}, `Batch ${batch.number + 1} waits for you`),
    h("p", {}, reason),
    h("dl", { class: "facts under" }, [
      ["Variants", rejected ? `${count(legal)}, and ${count(rejected)} rejected ones` : count(legal)], ["Frames", count(plan.frames)],
      ["CPU time", `about ${duration(Math.round(plan.cpu_seconds))}`], ["Disk", `about ${bytes(plan.bytes)}`],
    ].map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", { class: "number" }, text)))),
    plan.warnings.map((sentence) => h("p", { class: "note bad under" }, sentence)),
    may("POST /v1/studies/{study_id}/accept") ? h("form", { class: "row under", on: { submit } },
      h("label", { class: "inline", for: "count" }, "Variants", number), h("button", { type: "submit", class: "primary" }, "Accept"),
      h("span", { class: "small soft" }, `1 to ${count(most)}; for another number, the strategy proposes other variants.`)) : h("p", { class: "small soft under" }, `The token's role is ${role()}: a runner accepts the batch.`));
}

function history({ batches }, progress) {
  if (!batches.length) return h("section", { class: "card" }, h("h2", {}, "Batches"), h("p", { class: "soft" }, "The first batch is proposed soon."));
  const right = (text) => ({ text, class: "right" });
  const total = (of) => count(batches.reduce((sum, batch) => sum + of(batch), 0));
  const rows = batches.map((batch) => h("tr", {},
    h("th", { scope: "row", class: "number" }, count(batch.number + 1)), h("td", { class: "reason" }, batch.reason),
    h("td", {}, ran(batch, progress.get(batch.run_id))),
    OUTCOMES.map(([name]) => h("td", { class: "right" }, count(batch.counts?.[name]))),
    h("td", { class: "right" }, count(batch.rejected.length)),
    h("td", { class: "right" }, batch.cpu_seconds === null ? NONE : duration(batch.cpu_seconds))));
  const sum = h("tr", { class: "all" }, h("th", { scope: "row", colspan: 3 }, "All"), OUTCOMES.map(([name]) => h("td", { class: "right" }, total((batch) => batch.counts?.[name] ?? 0))),
    h("td", { class: "right" }, total((batch) => batch.rejected.length)), h("td", { class: "right" }, duration(Math.round(batches.reduce((all, batch) => all + (batch.cpu_seconds ?? 0), 0)))));
  return h("section", { class: "card batches" }, h("h2", {}, "Batches"),
    table(["Batch", "Reason", "Run", ...OUTCOMES.map(([, text]) => right(text)), right("Rejected"), right("CPU")], [...rows, batches.length > 1 ? sum : null].filter(Boolean), { caption: "Batches" }),
    h("p", { class: "small soft under" }, "An undefined variant has no score: it neither fails nor passes. Rejected variants are not rendered and cost nothing."));
}

function ran(batch, run) {
  if (!batch.accepted_at) return h("span", { class: "chip wait" }, "waits for you");
  if (!batch.run_id) return h("span", { class: "soft" }, batch.legal ? "starts soon" : "nothing to run");
  const link = h("a", { class: "mono", href: `#/runs/${batch.run_id}` }, batch.run_id);
  if (batch.outcomes) return link;
  const stage = run?.stages.eval;
  return [link, h("div", { class: "small soft number" }, run ? words(run.state) : "no such run", stage?.total ? `, ${count(stage.done)} of ${plural(stage.total, "evaluation")}` : "")];
}
