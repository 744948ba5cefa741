// Who is at work, and what waits for whom.
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
  return h("section", { class: "card empty" }, h("h2", {}, "No worker is alive"),
    h("p", {}, "Runs wait until one starts. On this machine, server and workers start together:"), command("valerie up"),
    h("p", { class: "small" }, "elsewhere: ", h("code", {}, "valerie worker render"), ", ", h("code", {}, "valerie worker infer"), ", ", h("code", {}, "valerie worker eval")));
}

function card(worker) {
  const offers = worker.offers.map((one) => h("li", {}, h("strong", {}, one.name), h("div", { class: "small soft mono" }, one.numeric_class)));
  return h("section", { class: "card worker" },
    h("div", { class: "row" }, h("h2", {}, STAGES[worker.stage] ?? worker.stage), h("span", { class: "chip good" }, "alive")),
    h("p", { class: "small soft" }, `${worker.host}, process ${worker.pid}, for ${duration(Math.max(0, Math.round(Date.now() / 1000 - worker.started_at)))}`),
    offers.length ? h("ul", { class: "offers" }, offers) : h("p", { class: "small" }, "counts predictions against ground truth; the same on every machine"));
}

function queueTable(routes) {
  const silent = routes.some((one) => one.messages === null);
  const head = ["Queue", ...["Waiting", "Ready", "In work", "Messages", "Workers"].map((text) => ({ text, class: "right" })), ""];
  const rows = routes.map((one) => {
    const open = one.waiting + one.ready + one.running;
    return h("tr", {}, h("th", { scope: "row", class: "mono" }, one.route),
      [one.waiting, one.ready, one.running].map((n) => h("td", { class: "right" }, count(n))),
      h("td", { class: "right" }, one.messages === null ? NONE : count(one.messages)),
      h("td", { class: "right" }, count(one.workers)),
      h("td", {}, open && !one.workers ? h("span", { class: "chip bad" }, "nobody serves it") : open ? null : h("span", { class: "soft small" }, "idle")));
  });
  return h("section", { class: "card" }, h("h2", {}, "Queues"),
    silent ? h("p", { class: "note bad" }, "The broker does not answer: messages cannot be counted, and nothing is sent until it does. No work is lost.") : null,
    table(head, rows, { caption: "Queues" }),
    h("p", { class: "small soft under" }, "A product waits until its inputs are done, is ready until a worker claims it, and is in work under a lease. One message names several products."));
}
