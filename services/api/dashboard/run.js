// One run: its progress, then its results.
import { download, get, hasToken, post, remove } from "./api.js";
import { confirm, h, put, table, toast } from "./dom.js";
import { ACTIVE, ago, clock, count, duration, look, plural, rate, words } from "./format.js";
import { lineageSection } from "./lineage.js";
import { marksOf } from "./marks.js";
import { poll } from "./poll.js";
import { may } from "./role.js";
import { bar } from "./runs.js";
import { scatterSection } from "./scatter.js";
import { summarySection } from "./summary.js";

const STAGES = { render: "Render", infer: "Infer", eval: "Evaluate" };
const WHAT = { render: "frames", infer: "predictions", eval: "evaluations" };

const ACTIONS = [
  { verb: "resume", text: "Resume", states: ["paused", "cancelled"], done: "The run continues." },
  { verb: "retry", text: "Retry failures", states: ["running", "completed-with-failures", "failed"], needs: (f) => f > 0, done: "Failed products are tried again." },
  { verb: "cancel", text: "Cancel", states: ["submitted", "running", "paused"], ask: { title: "Cancel this run?", text: "Finished products stay and can be viewed; the rest is not computed. You can resume a cancelled run.", action: "Cancel the run" }, done: "The run is cancelled." },
  { verb: "delete", text: "Delete", danger: true, states: ["completed", "completed-with-failures", "cancelled", "failed"], ask: { title: "Delete this run?", text: "This deletes its frames, results, report, tags and notes. Pictures that other runs use stay; valerie gc frees the rest. This cannot be undone.", action: "Delete for good", danger: true }, done: "The run is deleted." },
];

export async function runView({ main, key, parameters, signal }) {
  const path = `/v1/runs/${key}`;
  let run = await get(path, { signal });
  let progress = await get(`${path}/progress`, { signal });

  // Explore lists the frames once there are rows.
  const browse = async () => {
    const { items } = await get(`${path}/frames?limit=1`, { signal });
    if (items.length) location.hash = `#/frames/${items[0].id}`;
    else toast("There is no frame yet.");
  };
  const marks = marksOf(key, signal);
  const lineage = h("div", { class: "slot" });
  const parent = h("a", { href: `#/runs/${run.parent_run}` }, run.parent_run);
  const chip = h("span", {});
  const actions = h("div", { class: "row" });
  const reason = h("div", { class: "slot" });
  const stages = h("div", { class: "stages" });
  const facts = h("p", { class: "soft small" });
  const failures = h("div", {});
  const rejections = h("div", {});
  const summary = h("div", { class: "slot" });
  const scatter = scatterSection({ path, parameters, signal });
  const work = h("section", { class: "card", "aria-label": "Progress" }, h("h2", {}, "Progress"), stages, rejections, failures);
  main.replaceChildren(
    h("div", { class: "stack" },
      h("p", { class: "crumbs" }, h("a", { href: "#/" }, "Runs"), " / ", h("span", { class: "mono" }, key)),
      h("div", { class: "spread" },
        h("div", { class: "stack" }, h("div", { class: "row" }, h("h1", {}, run.name), chip), facts, run.parent_run ? h("p", { class: "soft small" }, "Descends from ", parent) : null, marks.place("run", "", "this run")),
        actions)),
    reason, work, summary, scatter.element, lineage, specSection(run));

  const act = async ({ verb, ask, done }) => {
    if (ask && !(await confirm(ask))) return;
    try {
      if (verb === "delete") {
        await remove(path);
        toast(done);
        location.hash = "#/";
        return;
      }
      await post(`${path}/${verb}`);
      toast(done);
      seen = "";
      again();
    } catch (error) {
      toast(error.message);
    }
  };

  let seen = "";
  let points = -1;
  const update = async () => {
    const state = progress.state;
    const failed = Object.values(progress.stages).reduce((sum, stage) => sum + stage.failed, 0);
    put(chip, state, h("span", { class: `chip ${look(state)}` }, words(state)));
    const offered = ACTIONS.filter((one) => one.states.includes(state) && (!one.needs || one.needs(failed)) && may(one.verb === "delete" ? "DELETE /v1/runs/{run_id}" : `POST /v1/runs/{run_id}/${one.verb}`));
    const evaluated = progress.stages.eval?.done ?? 0;
    put(actions, [offered.map((one) => one.verb), Boolean(run.finished_at), evaluated > 0],
      evaluated ? h("a", { class: "button", href: `#/explore?runs=${key}&tab=pictures&sort=&crop=0&show=rows` }, "Frames") : h("button", { type: "button", on: { click: () => browse().catch((error) => toast(error.message)) } }, "Frames"), run.started_at ? [h("a", { class: "button", href: `#/explore?runs=${key}` }, "Explore"), run.spec.functions.length > 1 ? h("a", { class: "button", href: `#/explore?runs=${key}&tab=compare&show=rows` }, "Compare functions") : null] : null, resultLinks(run, key),
      may("POST /v1/runs") ? [h("a", { class: "button", href: `#/new?run=${key}` }, "Clone"), h("a", { class: "button", href: `#/new?parent=${key}` }, "Edit and rerun")] : null, offered.map((one) => h("button", { type: "button", class: one.danger ? "danger" : null, on: { click: () => act(one) } }, one.text)));
    put(reason, [progress.reason, state], progress.reason ? h("p", { class: `note ${look(state) === "bad" ? "bad" : "wait"}` }, progress.reason) : null);
    const left = remaining(progress);
    put(facts, [state, run.started_at, ago(run.created_at), progress.variants, left, progress.outlook],
      run.project ? `Project ${run.project} · ` : "", `Submitted ${ago(run.created_at)}`, run.finished_at && run.started_at ? ` · took ${duration(Math.round((new Date(run.finished_at) - new Date(run.started_at)) / 1000))}` : "",
      ` · ${plural(progress.variants.total, "variant")}`, progress.variants.fed < progress.variants.total ? `, ${count(progress.variants.fed)} begun` : "",
      progress.variants.rejected ? `, ${count(progress.variants.rejected)} rejected` : "", left && ` · ${left}`, progress.outlook && ` · ${progress.outlook}`);
    facts.title = clock(run.created_at);
    put(stages, [progress.stages, ACTIVE.has(state)], Object.keys(progress.stages).length
      ? Object.entries(progress.stages).map(([name, stage]) => stageRow(name, stage, ACTIVE.has(state)))
      : h("p", { class: "soft" }, state === "submitted" ? "Waiting to start." : "No progress counted yet."));
    const now = `${state} ${failed} ${progress.variants.rejected}`;
    if (now !== seen) {
      seen = now;
      run = await get(path, { signal });
      await Promise.all([
        failed ? get(`${path}/failures?limit=50`, { signal }).then((list) => put(failures, list, failureList(key, list, failed))) : put(failures, null),
        progress.variants.rejected ? get(`${path}/rejections`, { signal }).then((found) => put(rejections, found, rejectionList(found))) : null,
        state.startsWith("completed") ? get(`${path}/summary`, { signal }).then((found) => put(summary, found, summarySection(found, (sentence) => marks.place("finding", sentence, "this finding")))) : put(summary, null),
      ]);
      (state.startsWith("completed") ? summary : reason).after(work); // verdicts come first
    }
    if (evaluated !== points) {
      points = evaluated;
      await scatter.load(evaluated);
    }
  };
  await update();
  marks.load().catch(() => {});
  get(`${path}/lineage`, { signal }).then((relatives) => {
    put(lineage, relatives, lineageSection(relatives, key));
    parent.textContent = relatives.find((one) => one.id === run.parent_run)?.name ?? run.parent_run;
  }).catch(() => {});

  const again = poll(signal, async () => {
    progress = await get(`${path}/progress`, { signal });
    await update();
    return ACTIVE.has(progress.state) ? 1000 : 15_000;
  });
  return run.name;
}

// Of the stage that ends last, since the others wait for it or it for them.
function remaining({ state, stages }) {
  const open = Object.values(stages).filter(({ done, failed, total }) => done + failed < total);
  if (!ACTIVE.has(state) || !open.length) return "";
  return open.some((one) => one.eta_s === null) ? "remaining time not known yet" : `about ${duration(Math.max(...open.map((one) => one.eta_s)))} left`;
}

function stageRow(name, stage, active) {
  const { done, total, failed } = stage;
  const parts = [];
  if (active && stage.running) parts.push(`${plural(stage.running, "product")} in progress`);
  if (active && stage.rate_per_s > 0 && done < total) parts.push(rate(stage.rate_per_s));
  return h("div", { class: "stage" },
    h("h3", {}, STAGES[name] ?? name),
    bar(done, failed, total, `${STAGES[name]}: ${WHAT[name]}`),
    h("span", { class: "number" }, h("strong", {}, count(done)), h("span", { class: "soft" }, ` / ${count(total)} ${WHAT[name]}`)),
    h("span", { class: "small soft number detail" }, failed ? h("span", { class: "lost" }, `${count(failed)} failed`) : null, failed && parts.length ? " · " : "", parts.join(" · ")));
}

function rejectionList(found) {
  const reasons = Object.entries(found).sort((a, b) => b[1] - a[1]);
  const total = reasons.reduce((sum, [, n]) => sum + n, 0);
  return h("details", { class: "more" }, h("summary", {}, `${plural(total, "variant")} rejected, without frames`),
    h("ul", {}, reasons.slice(0, 100).map(([text, n]) => h("li", {}, text, h("span", { class: "soft number" }, ` · ${count(n)}`)))));
}

function failureList(key, list, failed) {
  const roots = list.filter((one) => !one.error?.cause);
  return h("details", { class: "more", open: true }, h("summary", {}, `${plural(roots.length, "product")} failed for good`, failed > roots.length ? h("span", { class: "soft" }, "; products that depend on them failed too") : null),
    table(["Frame", "Product", "Error", { text: "Attempts", class: "right" }], roots.map((one) => h("tr", {},
      h("td", {}, h("a", { href: `#/frames/${key}.${one.variant_index}.${one.camera_index}.${one.time_index}` }, h("span", { class: "mono" }, `${one.variant_index}.${one.camera_index}.${one.time_index}`))),
      h("td", {}, one.kind),
      h("td", {}, h("strong", {}, one.error?.type ?? ""), " ", one.error?.message ?? ""),
      h("td", { class: "right" }, count(one.error?.attempts)))), { caption: "Failures" }));
}

function resultLinks(run, key) {
  if (!run.started_at) return [];
  const files = [["CSV", "csv"], ["Parquet", "parquet"]].map(([text, format]) => fileLink(text, `/v1/runs/${key}/evaluations?format=${format}`, `${key}-evaluations.${format}`));
  return [
    ["completed", "completed-with-failures"].includes(run.state) ? fileLink("Report", `/v1/runs/${key}/report`, `${key}-report.html`, true) : null,
    ...files,
  ];
}

// Without a token a plain link is best: the browser streams the file and opens the report in a new tab.
export function fileLink(text, path, name, page = false) {
  const label = page ? text : `↓ ${text}`;
  if (hasToken()) return h("button", { type: "button", on: { click: () => download(path, name).catch((error) => toast(error.message)) } }, label);
  return h("a", { class: "button", href: path, ...(page ? { target: "_blank", rel: "noopener" } : { download: name }) }, label);
}

function specSection(run) {
  const render = run.pins?.render ?? [run.pins], infer = run.pins?.infer ?? [run.pins];
  const joined = (offers) => [...new Set(offers.filter(Boolean).map((offer) => offer.numeric_class))].join(" or ");
  const pins = run.pins ? [["Image", joined(render.map((one) => one.engine))], ["Ground truth", joined(render.map((one) => one.truth))],
    ...Object.entries(run.pins.functions ?? {}).map(([name, pin]) => [name, joined(infer.map((one) => one.functions[name] ?? pin))])] : [];
  return h("details", { class: "card spec" }, h("summary", {}, h("h2", {}, "Spec and provenance")),
    h("dl", { class: "facts" },
      [["Spec digest", run.spec_digest], ["Asset digest", run.asset_digest], ["Parent run", run.parent_run], ["Iteration", run.parent_run ? run.iteration : null],
        ...pins].filter(([, text]) => text !== null && text !== undefined)
        .map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", { class: "mono" }, name === "Parent run" ? h("a", { href: `#/runs/${text}` }, text) : String(text))))),
    h("pre", { tabindex: "0" }, JSON.stringify(run.spec, null, 2)));
}
