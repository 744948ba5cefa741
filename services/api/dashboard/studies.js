// The list of studies.
import { get } from "./api.js";
import { command, h, put } from "./dom.js";
import { ago, clock, plural, words } from "./format.js";
import { poll } from "./poll.js";
import { may, reaching } from "./role.js";

const PAGE = 50;
const LOOKS = { running: "active", paused: "wait", finished: "good", stopped: "ended" };
export const measured = ({ measure, where }) => `A variant passes with ${measure}${where ? ` where ${where}` : ""}.`;

// A running study with a reason waits for a person, or for room in its owner's quotas.
export function stateChip({ state, reason }) {
  const waits = state === "running" && reason;
  return h("span", { class: `chip ${waits ? "wait" : LOOKS[state] ?? ""}` }, waits ? "waits" : words(state));
}

export async function studiesView({ main, signal }) {
  let pages = 1;
  const list = h("div", { class: "stack" });
  const more = h("button", { type: "button", hidden: true, on: { click: () => { pages += 1; again(); } } }, "Show earlier studies");
  const draw = async () => {
    const items = [];
    let next = null;
    for (let page = 0; page < pages; page += 1) {
      const answer = await get(`/v1/studies?limit=${PAGE}${next ? `&cursor=${encodeURIComponent(next)}` : ""}`, { signal });
      items.push(...answer.items);
      next = answer.next;
      if (!next) break;
    }
    more.hidden = !next;
    put(list, items.map((study) => [study, ago(study.created_at)]), items.length ? h("section", { class: "card studies" }, items.map(entry)) : nothing());
    return items.some((study) => study.state === "running") ? 2000 : 10_000;
  };
  await draw();
  main.replaceChildren(h("div", { class: "spread" }, h("h1", {}, "Studies"), h("a", { class: "button primary", href: "#/studies/new" }, may("POST /v1/studies") ? "New study" : "Plan a study")), list, h("div", { class: "row" }, more));
  const again = poll(signal, draw);
  return "Studies";
}

function nothing() {
  return h("section", { class: "card empty" },
    h("h2", {}, "No study yet"),
    h("p", {}, "A study is a question with a budget: it proposes variants, runs them and decides what comes next."),
    may("POST /v1/studies") ? [h("p", { class: "small" }, h("a", { href: "#/studies/new" }, "Write one here"), ", or write and submit a file:"),
      command("valerie study new study.yaml"), command(reaching("valerie study submit study.yaml", { url: true }))] : null);
}

function entry(study) {
  const known = study.result?.sentences[0];
  return h("article", {},
    h("div", { class: "row" }, h("h2", {}, h("a", { href: `#/studies/${study.id}` }, study.name)), stateChip(study)),
    h("p", {}, h("strong", {}, study.question), " ", h("span", { class: "soft" }, measured(study))),
    known ? h("p", {}, known) : null,
    h("p", { class: "small soft" }, [study.reason, `${plural(study.budget.variants, "variant")} at most`, study.by_hand ? "by hand" : "automatic",
      h("span", { title: clock(study.created_at) }, `begun ${ago(study.created_at)}`), h("span", { class: "mono" }, study.id)]
      .filter(Boolean).flatMap((part, i) => (i ? [" · ", part] : [part]))));
}
