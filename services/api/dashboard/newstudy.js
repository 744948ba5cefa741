// A new study: its document as text, its first batch and its price, and its start.
import { get, post, postSpec } from "./api.js";
import { confirm, h, put, toast } from "./dom.js";
import { editor } from "./editor.js";
import { count, duration, plural } from "./format.js";
import { KEPT, located, planSection, problemList } from "./new.js";
import { may, role } from "./role.js";

const KEY = `${KEPT} study`;

export async function newStudyView({ main, signal }) {
  const [{ text: template }, assets, engines, functions] = await Promise.all(["/v1/studies/template", "/v1/assets", "/v1/renderers", "/v1/functions"].map((path) => get(path, { signal })));
  const named = (list) => [...new Set(list.filter((one) => !one.problem).map((one) => one.name))];
  const names = { assets: named(assets), engines: named(engines), functions: named(functions), cameras: [], parameters: [] };
  const starts = may("POST /v1/studies");
  const problems = h("div", { id: "problems", class: "slot", "aria-live": "polite" });
  const planned = h("div", { "aria-live": "polite" });
  const plan = h("button", { type: "button", on: { click: () => ask(showPlan) } }, "Plan");
  const start = h("button", { type: "button", class: "primary", disabled: true, on: { click: () => ask(begin) } }, "Start");
  const text = editor({ label: "Study as YAML", known: () => ({ schema: {}, names }), changed: () => { sessionStorage.setItem(KEY, text.text); show(null, []); } });

  let draft = null;
  // What was answered about the present text; a change of it takes the answer away.
  const show = (batch, list) => {
    start.disabled = !batch;
    const wrong = located(list, draft, text);
    put(problems, wrong, problemList(wrong, text));
    put(planned, [batch, wrong.length], batch ? firstBatch(batch, draft.fields) : h("p", { class: "soft" }, "Plan shows the first batch and its price; then the study can start."));
  };
  const ask = async (answer) => {
    const asked = text.text;
    plan.disabled = start.disabled = true;
    try {
      draft = await post("/v1/draft", { text: asked }, { signal });
      await answer(asked);
    } catch (error) {
      if (error.name === "AbortError") return;
      if (asked === text.text) show(null, error.errors?.length ? error.errors : [{ field: "", message: error.message }]);
    } finally {
      plan.disabled = false;
    }
  };
  const showPlan = async (asked) => {
    const batch = await postSpec("/v1/studies/plan", asked, { signal });
    if (asked === text.text) show(batch, []);
  };
  const begin = async (asked) => {
    const study = await postSpec("/v1/studies", asked, { signal });
    sessionStorage.removeItem(KEY);
    toast("The study begins.");
    location.hash = `#/studies/${study.id}`;
  };
  const write = (written) => { text.text = written; show(null, []); };
  const restart = async () => {
    if (!(await confirm({ title: "Start over?", text: "What is written here is lost.", action: "Start over", danger: true }))) return;
    sessionStorage.removeItem(KEY);
    write(template);
  };

  const title = starts ? "New study" : "Plan a study";
  main.replaceChildren(
    h("div", { class: "stack" }, h("p", { class: "crumbs" }, h("a", { href: "#/studies" }, "Studies"), " / new"),
      h("div", { class: "spread" }, h("h1", {}, title), h("div", { class: "row" }, h("button", { type: "button", on: { click: restart } }, "Start over"), plan, starts ? start : null)),
      starts ? null : h("p", { class: "note" }, `The token's role is ${role()}: it plans studies, and a runner starts them.`)),
    h("div", { class: "draft" },
      h("section", { class: "card tall" }, h("h2", {}, h("label", { for: "spec" }, "Document")), text.element, problems),
      h("section", { class: "card", "aria-label": "Plan" }, h("h2", {}, "First batch"), planned)));
  write(sessionStorage.getItem(KEY) ?? template);
  return title;
}

function firstBatch({ reason, legal, rejected, plan }, { budget, goal }) {
  const whole = plan.start_cpu_seconds + (plan.cpu_seconds - plan.start_cpu_seconds) / legal * budget.variants;
  const price = goal.name === "cascade" ? "Batches by the costly engine cost more: each is priced when it is proposed."
    : `The budget of ${count(budget.variants)} variants takes about ${duration(Math.round(whole))} of CPU time at this price.`;
  return [
    h("p", {}, reason, rejected ? ` ${plural(rejected, "variant")} rejected.` : ""),
    h("div", { class: "under" }, planSection(plan)),
    legal ? h("p", { class: "under" }, price) : null,
  ];
}
