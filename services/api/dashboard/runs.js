// The list of runs.
import { get } from "./api.js";
import { command, h, put } from "./dom.js";
import { ACTIVE, ago, clock, count, duration, look, percent, plural, words } from "./format.js";
import { tagList } from "./marks.js";
import { poll } from "./poll.js";
import { may, reaching } from "./role.js";

const PAGE = 50;

export async function runsView({ main, parameters, signal }) {
  let pages = 1;
  const tag = parameters.get("tag");
  const filter = h("div", { class: "slot row tags" });
  const list = h("div", { class: "stack" });
  const body = h("tbody", {});
  const table = runsTable(body);
  const rows = new Map(); // of the table; a poll changes cells, and a link being clicked stays
  const keep = (id) => rows.set(id, emptyRow()).get(id);
  const more = h("button", { type: "button", hidden: true, on: { click: () => { pages += 1; again(); } } }, "Show earlier runs");
  const draw = async () => {
    const items = [];
    let next = null;
    for (let page = 0; page < pages; page += 1) {
      const answer = await get(`/v1/runs?limit=${PAGE}${tag ? `&tag=${encodeURIComponent(tag)}` : ""}${next ? `&cursor=${encodeURIComponent(next)}` : ""}`, { signal });
      items.push(...answer.items);
      next = answer.next;
      if (!next) break;
    }
    more.hidden = !next;
    const known = await get("/v1/tags", { signal });
    put(filter, known, Object.keys(known).length || tag ? [h("span", { class: "small soft" }, "Tags"), tagLinks(known, tag)] : null);
    for (const run of items) fillRow(rows.get(run.id) ?? keep(run.id), run);
    put(body, items.map((run) => run.id), items.map((run) => rows.get(run.id)));
    put(list, [items.length > 0], items.length ? table : tag ? h("p", { class: "card empty" }, "No run carries this tag.") : nothing());
    return items.some((run) => ACTIVE.has(run.state)) ? 2000 : 10_000;
  };
  await draw();
  main.replaceChildren(h("div", { class: "spread" }, h("h1", {}, "Runs"), h("a", { class: "button primary", href: "#/new" }, submits() ? "New run" : "Plan a run")), filter, list, h("div", { class: "row" }, more));
  const again = poll(signal, draw);
  return "Runs";
}

const submits = () => may("POST /v1/runs");

function tagLinks(known, chosen) {
  const tags = [...new Set([...Object.keys(known), ...(chosen ? [chosen] : [])])];
  return tags.map((one) => h("a", { class: "tag", href: one === chosen ? "#/" : `#/?tag=${encodeURIComponent(one)}`, "aria-current": one === chosen ? "true" : null, title: one === chosen ? "Show all runs" : null },
    one, " ", h("span", { class: "number" }, count(known[one] ?? 0)), one === chosen ? " ✕" : ""));
}

function nothing() {
  return h("section", { class: "card empty" },
    h("h2", {}, "No run yet"),
    h("p", {}, "A run varies a scene, renders it and measures how well functions see pedestrians.", submits() ? " Start the first one:" : ""),
    submits() && command(reaching("valerie run examples/first-run.yaml")),
    submits() && h("p", { class: "small" }, "or ", h("a", { href: "#/new" }, "write a new one here"), ", or submit a file with ", h("code", {}, reaching("valerie submit SPEC", { url: true })), "."));
}

const HEAD = ["Run", "State", "Progress", "Variants", "Submitted", "Took"];
const RIGHT = new Set(["Variants", "Took"]);

function runsTable(body) {
  return h("section", { class: "card runs" },
    h("table", {},
      h("thead", {}, h("tr", {}, HEAD.map((text) => h("th", { scope: "col", class: RIGHT.has(text) ? "right" : null }, text)))),
      body));
}

function emptyRow() {
  return h("tr", {}, HEAD.map((text) => h("td", text === "Run" ? { class: "name" } : { class: text === "Progress" ? "progress-cell" : RIGHT.has(text) ? "right" : null, "data-label": text })));
}

function fillRow(row, run) {
  const [name, state, progress, variants, submitted, took] = row.children;
  const { done, failed, total } = run.stages.eval ?? { done: 0, failed: 0, total: 0 };
  const share = total ? (done + failed) / total : run.state === "completed" ? 1 : 0;
  const seconds = run.started_at ? Math.round((new Date(run.finished_at ?? Date.now()) - new Date(run.started_at)) / 1000) : null;
  const reason = ACTIVE.has(run.state) ? run.reason : null;
  put(name, [run.name, run.tags, reason], h("a", { href: `#/runs/${run.id}` }, run.name), h("div", { class: "small soft mono" }, run.id), run.tags.length ? h("div", { class: "row tags" }, tagList(run.tags)) : null,
    reason ? h("div", { class: "small soft" }, reason) : null);
  put(state, [run.state, run.archived], h("span", { class: `chip ${look(run.state)}` }, words(run.state)), run.archived ? h("div", { class: "small soft" }, "archived") : null);
  put(progress, [done, failed, total, share], total
    ? h("div", { class: "stack" }, bar(done, failed, total), h("div", { class: "small soft number" }, `${percent(share, share < 1 ? 1 : 0)} of ${plural(total, "evaluation")}`))
    : h("span", { class: "soft" }, "not started"));
  put(variants, [run.variant_count, run.rejected_count], count(run.variant_count), run.rejected_count ? h("div", { class: "small soft" }, `${count(run.rejected_count)} rejected`) : null);
  submitted.title = clock(run.created_at);
  put(submitted, ago(run.created_at), ago(run.created_at));
  put(took, seconds, duration(seconds));
}

export function bar(done, failed, total, label) {
  const width = (part) => `${total ? (100 * part) / total : 0}%`;
  return h("div", { class: "meter", role: "progressbar", "aria-label": label ?? "Progress", "aria-valuemin": 0, "aria-valuemax": total, "aria-valuenow": done + failed,
    "aria-valuetext": `${count(done)} of ${count(total)} done${failed ? `, ${count(failed)} failed` : ""}` },
  h("span", { class: "done", style: { width: width(done) } }), failed ? h("span", { class: "failed", style: { width: width(failed) } }) : null);
}
