// Living workers and what they do, the queues that they serve, what products cost, why they failed, and the space left.
import { get } from "./api.js";
import { command, h, put, s, table } from "./dom.js";
import { NONE, ago, bytes, clock, count, duration, fixed, plural, words } from "./format.js";
import { poll } from "./poll.js";
import { reaching } from "./role.js";

const STAGES = { render: "Render", infer: "Infer", eval: "Evaluate" };
const REACH = [[1, "hour"], [24, "day"], [168, "week"]];

export async function workersView({ main, parameters, signal }) {
  const [people, queues, space, costs, failures] = Array.from({ length: 5 }, () => h("div", { class: "slot" }));
  let hours = REACH.some(([one]) => String(one) === parameters.get("hours")) ? Number(parameters.get("hours")) : 24;
  const reach = h("div", { class: "segments", role: "group", "aria-label": "How far back" }, REACH.map(([one, text]) =>
    h("button", { type: "button", "data-hours": one, on: { click: () => { hours = one; history.replaceState(history.state, "", `#/workers?hours=${one}`); again(); } } }, text)));
  let looked = 0;
  const draw = async () => {
    const [workers, routes, work] = await Promise.all([get("/v1/workers", { signal }), get("/v1/queues", { signal }), Date.now() - looked > 10_000 || looked < 0 ? get(`/v1/work?hours=${hours}`, { signal }) : null]);
    put(people, workers.map((one) => [one.id, one.offers, one.makes, one.resting, one.clock, Math.round((Date.now() / 1000 - one.started_at) / 60)]), workers.length ? workers.map(card) : nobody());
    put(queues, routes, queueTable(routes));
    if (work) {
      looked = Date.now();
      put(space, [work.free_bytes, work.min_free_bytes], spaceNote(work));
      put(costs, work, h("section", { class: "card" }, h("div", { class: "head" }, h("h2", {}, "Cost per product"), reach), costCharts(work)));
      put(failures, work.failures, failureTable(work.failures));
      for (const button of reach.children) button.setAttribute("aria-pressed", String(Number(button.dataset.hours) === hours));
    }
    return 2000;
  };
  await draw();
  people.className = "people";
  main.replaceChildren(h("h1", {}, "Workers"), space, people, queues, costs, failures);
  const once = poll(signal, draw);
  const again = () => { looked = -1; once(); };
  return "Workers";
}

function nobody() {
  return h("section", { class: "card empty" }, h("h2", {}, "No living worker"),
    h("p", {}, "Runs wait until a worker starts. On this machine, server and workers start together:"), command(reaching("valerie up")),
    h("p", { class: "small" }, "on other machines: ", h("code", {}, "valerie worker render"), ", ", h("code", {}, "valerie worker infer"), ", ", h("code", {}, "valerie worker eval")));
}

function card(worker) {
  const offers = worker.offers.map((one) => h("li", {}, h("strong", {}, one.name), h("div", { class: "small soft mono" }, one.numeric_class)));
  const makes = Object.entries(worker.makes).map(([kind, n]) => plural(n, kind));
  return h("section", { class: "card worker" },
    h("div", { class: "row" }, h("h2", {}, STAGES[worker.stage] ?? worker.stage), worker.resting ? h("span", { class: "chip bad" }, "put aside") : h("span", { class: `chip ${makes.length ? "active" : "good"}` }, makes.length ? `makes ${makes.join(", ")}` : "idle")),
    worker.resting ? h("p", { class: "note bad" }, h("span", {}, "Its last products failed, and so does the test of its machine: ", worker.resting, ". It tests again every minute.")) : null,
    worker.clock ? h("p", { class: "note wait" }, `Its clock is ${worker.clock}.`) : null,
    h("p", { class: "small soft" }, `${worker.host}, process ${worker.pid}, for ${duration(Math.max(0, Math.round(Date.now() / 1000 - worker.started_at)))}`),
    offers.length ? h("ul", { class: "offers" }, offers) : h("p", { class: "small" }, "compares predictions with ground truth; gives the same result on every machine"));
}

function queueTable(routes) {
  const silent = routes.some((one) => one.messages === null);
  const unknown = routes.some((one) => one.ready === null || one.workers === null);
  const head = ["Queue", ...["Waiting", "Ready", "Running", "Per minute", "Messages", "Workers"].map((text) => ({ text, class: "right" })), "State"];
  const rows = routes.map((one) => {
    const open = one.waiting + one.ready + one.running;
    return h("tr", {}, h("th", { scope: "row", class: "mono" }, one.route),
      [one.waiting, one.ready, one.running].map((n) => h("td", { class: "right" }, count(n))),
      h("td", { class: "right" }, one.per_minute ? fixed(one.per_minute, one.per_minute < 10 ? 1 : 0) : NONE),
      h("td", { class: "right" }, one.messages === null ? NONE : count(one.messages)),
      h("td", { class: "right" }, count(one.workers)),
      h("td", {}, one.ready === null || one.workers === null ? h("span", { class: "soft small" }, "unknown") : open && !one.workers ? h("span", { class: "chip bad" }, "no worker serves it") : open ? h("span", { class: "chip active" }, "at work") : h("span", { class: "soft small" }, "idle")));
  });
  return h("section", { class: "card" }, h("h2", {}, "Queues"),
    silent ? h("p", { class: "note bad" }, "The broker does not answer. Until it does, messages cannot be counted and nothing is sent. No work is lost.") : null,
    unknown ? h("p", { class: "note bad" }, "The database does not give all numbers in time.") : null,
    table(head, rows, { caption: "Queues" }),
    h("p", { class: "small soft under" }, "A product is waiting until its inputs are done, ready until a worker claims it, and running while a worker holds its lease. The rate is of the last two minutes. One message may name several products."));
}

function spaceNote({ free_bytes: free, min_free_bytes: least }) {
  if (free === null) return null;
  const short = free < least * 4;
  return h("p", { class: `note ${free < least ? "bad" : short ? "wait" : ""}` },
    h("span", {}, h("strong", {}, `${bytes(free)} free`), ` for artifacts. Runs pause below ${count(least / 2 ** 20)} MiB`, short ? "; valerie gc frees what no run needs." : "."));
}

// One small chart for each kind: the mean CPU time of a product in each span.
function costCharts({ costs, since, span_s: span }) {
  if (!costs.length) return h("p", { class: "soft" }, "Nothing was made in this time.");
  const width = 260, height = 64;
  return h("div", { class: "costs" }, costs.map(({ kind, products, cpu_seconds: means }) => {
    const most = Math.max(...means.filter((one) => one !== null)) || 1;
    const total = products.reduce((sum, one) => sum + one, 0);
    const mean = means.reduce((sum, one, i) => sum + (one ?? 0) * products[i], 0) / total;
    const step = width / means.length;
    const label = `${words(kind)}: ${plural(total, "product")}, ${seconds(mean)} of CPU time each, at most ${seconds(most)} in one span`;
    return h("figure", {}, h("figcaption", {}, h("strong", {}, words(kind)), h("span", { class: "soft number" }, `${count(total)} × ${seconds(mean)}`)),
      s("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label }, s("line", { x1: 0, x2: width, y1: height - 0.5, y2: height - 0.5, class: "axis" }),
        means.map((one, i) => (one === null ? null : s("rect", { x: i * step, width: Math.max(1, step - 1), y: height - Math.max(1, (one / most) * (height - 4)), height: Math.max(1, (one / most) * (height - 4)), class: "cost" },
          s("title", {}, `${clock((since + i * span) * 1000)}: ${plural(products[i], "product")}, ${seconds(one)} each`))))));
  }));
}

const seconds = (one) => (one < 0.1 ? `${fixed(one * 1000, one < 0.01 ? 1 : 0)} ms` : `${fixed(one, 2)} s`);

function failureTable(reasons) {
  if (!reasons.length) return null;
  return h("section", { class: "card" }, h("h2", {}, "Failures by reason"),
    table(["Error", "Product", { text: "Failed", class: "right" }, "Latest", "Message of the latest"], reasons.map((one) => h("tr", {},
      h("th", { scope: "row" }, one.type), h("td", {}, words(one.kind)), h("td", { class: "right" }, count(one.products)), h("td", {}, ago(one.latest * 1000)), h("td", { class: "small" }, one.message))), { caption: "Failures by reason" }),
    h("p", { class: "small soft under" }, "Products that failed only because an input did are not counted."));
}
