// Living workers, and the queues that they serve.
import { get } from "./api.js";
import { command, h, put, table } from "./dom.js";
import { NONE, count, duration } from "./format.js";
import { poll } from "./poll.js";

const STAGES = { render: "Render", infer: "Infer", eval: "Evaluate" };

export async function workersView({ main, signal }) {
  const people = h("div", {});
  const queues = h("div", {});
  const draw = async () => {
    const [workers, routes] = await Promise.all([get("/v1/workers", { signal }), get("/v1/queues", { signal })]);
    put(people, workers.map((one) => [one.id, one.offers, Math.round((Date.now() / 1000 - one.started_at) / 60)]), workers.length ? workers.map(card) : nobody());
    put(queues, routes, queueTable(routes));
    return 2000;
  };
  await draw();
  people.className = "people";
  main.replaceChildren(h("h1", {}, "Workers"), people, queues);
  poll(signal, draw);
  return "Workers";
}

function nobody() {
  return h("section", { class: "card empty" }, h("h2", {}, "No living worker"),
    h("p", {}, "Runs wait until a worker starts. On this machine, server and workers start together:"), command("valerie up"),
    h("p", { class: "small" }, "on other machines: ", h("code", {}, "valerie worker render"), ", ", h("code", {}, "valerie worker infer"), ", ", h("code", {}, "valerie worker eval")));
}

function card(worker) {
  const offers = worker.offers.map((one) => h("li", {}, h("strong", {}, one.name), h("div", { class: "small soft mono" }, one.numeric_class)));
  return h("section", { class: "card worker" },
    h("div", { class: "row" }, h("h2", {}, STAGES[worker.stage] ?? worker.stage), h("span", { class: "chip good" }, "alive")),
    h("p", { class: "small soft" }, `${worker.host}, process ${worker.pid}, for ${duration(Math.max(0, Math.round(Date.now() / 1000 - worker.started_at)))}`),
    offers.length ? h("ul", { class: "offers" }, offers) : h("p", { class: "small" }, "compares predictions with ground truth; gives the same result on every machine"));
}

function queueTable(routes) {
  const silent = routes.some((one) => one.messages === null);
  const head = ["Queue", ...["Waiting", "Ready", "Running", "Messages", "Workers"].map((text) => ({ text, class: "right" })), ""];
  const rows = routes.map((one) => {
    const open = one.waiting + one.ready + one.running;
    return h("tr", {}, h("th", { scope: "row", class: "mono" }, one.route),
      [one.waiting, one.ready, one.running].map((n) => h("td", { class: "right" }, count(n))),
      h("td", { class: "right" }, one.messages === null ? NONE : count(one.messages)),
      h("td", { class: "right" }, count(one.workers)),
      h("td", {}, open && !one.workers ? h("span", { class: "chip bad" }, "no worker serves it") : open ? null : h("span", { class: "soft small" }, "idle")));
  });
  return h("section", { class: "card" }, h("h2", {}, "Queues"),
    silent ? h("p", { class: "note bad" }, "The broker does not answer. Until it does, messages cannot be counted and nothing is sent. No work is lost.") : null,
    table(head, rows, { caption: "Queues" }),
    h("p", { class: "small soft under" }, "A product is waiting until its inputs are done, ready until a worker claims it, and running while a worker holds its lease. One message may name several products."));
}
