// Routing: show the view of the address and end the previous one.
import { forgetToken, hasToken, keepToken } from "./api.js";
import { watch } from "./connection.js";
import { h, toast } from "./dom.js";
import { exploreView } from "./explore.js";
import { frameView } from "./frame.js";
import { functionsView } from "./functions.js";
import { newView } from "./new.js";
import { newStudyView } from "./newstudy.js";
import { learnRole, role, scopes } from "./role.js";
import { runView } from "./run.js";
import { runsView } from "./runs.js";
import { arrived } from "./signin.js";
import { studiesView } from "./studies.js";
import { studyView } from "./study.js";
import { workersView } from "./workers.js";

const ROUTES = [
  [/^\/?$/, "runs", () => runsView],
  [/^\/new$/, "runs", () => newView],
  [/^\/runs\/([\w-]+)$/, "runs", () => runView],
  [/^\/frames\/([\w.-]+)$/, "runs", () => frameView],
  [/^\/explore$/, "explore", () => exploreView],
  [/^\/studies$/, "studies", () => studiesView],
  [/^\/studies\/new$/, "studies", () => newStudyView],
  [/^\/studies\/([\w-]+)$/, "studies", () => studyView],
  [/^\/functions$/, "functions", () => functionsView],
  [/^\/workers$/, "workers", () => workersView],
];

const main = document.getElementById("view");
const forget = document.getElementById("forget");
let current = null;

function address() {
  const [path, query] = location.hash.slice(1).split("?");
  return { path: path || "/", parameters: new URLSearchParams(query) };
}

async function show() {
  const { path, parameters } = address();
  current?.end.abort();
  const scrolled = history.state?.scrolled ?? 0;
  const end = new AbortController();
  const route = ROUTES.find(([pattern]) => pattern.test(path));
  const mine = { end };
  current = mine;
  for (const link of document.querySelectorAll("[data-nav]")) {
    if (route && link.dataset.nav === route[1]) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  if (!route) {
    main.replaceChildren(h("section", { class: "card empty" }, h("h1", {}, "Page not found"), h("a", { href: "#/" }, "All runs")));
    return;
  }
  try {
    const key = route[0].exec(path)[1];
    await learnRole();
    forget.textContent = role() === "admin" && !scopes().length ? "Forget token" : `Forget token (${[role(), scopes().length ? `only ${scopes().join(", ")}` : ""].filter(Boolean).join(", ")})`;
    const title = await route[2]()({ main, key, parameters, signal: end.signal });
    if (current !== mine) return;
    document.title = title ? `${title} · VALERIE` : "VALERIE";
    main.focus({ preventScroll: true });
    scrollTo(0, scrolled);
  } catch (error) {
    if (error.name === "AbortError" || current !== mine) return;
    main.replaceChildren(h("section", { class: "card empty" },
      h("h1", {}, error.status === 404 ? "Not found" : "Something went wrong"), h("p", {}, error.message),
      h("div", { class: "row" }, h("button", { type: "button", on: { click: () => { current = null; show(); } } }, "Try again"), h("a", { class: "button", href: "#/" }, "All runs"))));
    if (!error.status && error.status !== 0) throw error;
  }
}

const secret = await arrived().catch((error) => toast(error.message));
if (secret) keepToken(secret);
forget.hidden = !hasToken();
forget.addEventListener("click", () => { forgetToken(); location.reload(); });
addEventListener("hashchange", show);
// Back and Forward return to where a page was left; the browser's own attempt comes before the page is drawn.
history.scrollRestoration = "manual";
addEventListener("scrollend", () => history.replaceState({ scrolled: scrollY }, ""));
show();
watch(document.getElementById("lost"));
