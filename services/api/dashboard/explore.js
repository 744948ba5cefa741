// Explore: linked views over the rows of one or several runs. Every view selects, and every view shows what is selected.
import { download, get, getBytes, post, remove } from "./api.js";
import { readArrow } from "./arrow.js";
import { confusionPanel } from "./confusion.js";
import { command, h, painted, put, table, toast } from "./dom.js";
import { ago, count, fixed, percent, plural } from "./format.js";
import { comparisonPanel, swingsPanel } from "./pairs.js";
import { colorKey, histogramPlot, labelOf, parallelPlot, scatterPlot, textOf, titleOf } from "./plots.js";
import { CHILDREN } from "./new.js";
import { isRemote, may, quoted, reaching } from "./role.js";
import { Brushes } from "./selection.js";
import { warningNotes } from "./summary.js";
import { errorLegend, thumbnails } from "./thumbnails.js";

const GROUPS = { score: "Scores", person: "Of the person", conditions: "Moment, light and picture", varied: "Varied", row: "Rows" };
const TABS = { pictures: "Pictures", table: "Table", compare: "Side by side", swings: "One change", confusion: "Confusion" };
const KINDS = { picture: "Picture", "truth-overlay": "Truth", overlay: "Prediction", errors: "Errors" };
const PAGE = 48;
const DATASETS = { cityscapes: ["Cityscapes", "pictures and label images of the frames"], coco: ["COCO", "pictures, instances and panoptic segments of the frames"] };

export async function exploreView({ main, parameters, signal }) {
  const runs = (parameters.get("runs") ?? "").split(",").filter(Boolean);
  if (!runs.length) return choose({ main, signal });
  const base = new URLSearchParams(runs.map((id) => ["run", id]));
  const [about, ...documents] = await Promise.all([get(`/v1/explore/columns?${base}`, { signal }), ...runs.map((id) => get(`/v1/runs/${id}`, { signal }))]);
  const columns = new Map(about.columns.map((one) => [one.name, one]));
  const numeric = about.columns.filter((one) => one.numeric);
  const differs = (one) => (one.numeric ? one.high > one.low : one.names.length > 1) || (one.undefined > 0 && one.undefined < about.rows);
  const first = (...names) => names.find((name) => columns.get(name)?.numeric) ?? numeric[0]?.name;
  const known = (names, otherwise) => { const kept = (names ?? "").split(",").filter((name) => columns.has(name)); return kept.length ? kept : otherwise; };
  const varied = about.columns.filter((one) => one.group === "varied" && differs(one)).map((one) => one.name);
  const several = ["run_id", "function", "camera", "sensor"].filter((name) => columns.get(name)?.names.length > 1);
  const usual = [...varied, "distance_m", "occlusion_rate", "pixel_area"].filter((name) => columns.has(name) && differs(columns.get(name)));

  // A run is shown by its name.
  const runName = (id) => { const { name } = documents.find((run) => run.id === id); return documents.filter((run) => run.name === name).length > 1 ? `${name} (${id})` : name; };

  if (columns.has("run_id")) columns.get("run_id").nameOf = runName;

  const state = {
    where: parameters.get("where") ?? "",
    brushes: new Brushes(parameters.getAll("b").filter((text) => columns.has(text.split("~")[0]))),
    x: known(parameters.get("x"), [first("distance_m")])[0],
    y: known(parameters.get("y"), [first("pacc")])[0],
    c: columns.has(parameters.get("c")) ? parameters.get("c") : parameters.has("c") ? "" : several[0] ?? "",
    h: known(parameters.get("h"), [...new Set(["pacc", ...several.slice(0, 1), ...usual])].filter((name) => columns.has(name)).slice(0, 8)),
    p: known(parameters.get("p"), [...new Set([...varied.slice(0, 4), "distance_m", "occlusion_rate", "pacc"])].filter((name) => columns.has(name) && differs(columns.get(name))).slice(0, 7)),
    tab: TABS[parameters.get("tab")] ? parameters.get("tab") : "pictures",
    sort: parameters.get("sort") ?? "pacc",
    kind: KINDS[parameters.get("kind")] ? parameters.get("kind") : "errors",
    crop: parameters.get("crop") !== "0",
    beside: parameters.get("beside"), // an expression; null: the rest
    fn: parameters.get("fn"), cell: parameters.get("cell"),
    before: parameters.get("before"), after: parameters.get("after"), outcome: parameters.get("outcome"),
    across: parameters.getAll("across").filter((name) => columns.has(name)), // paths
  };
  const where = () => state.brushes.where(state.where);
  const query = (more = {}) => {
    const text = where();
    const parts = new URLSearchParams([...base, ...(text ? [["where", text]] : [])]);
    for (const [name, value] of Object.entries(more)) for (const one of [value].flat()) if (one !== null && one !== undefined) parts.append(name, one);
    return parts;
  };
  const address = () => {
    const parts = new URLSearchParams({ runs: runs.join(",") });
    if (state.where.trim()) parts.set("where", state.where.trim());
    for (const text of state.brushes.texts()) parts.append("b", text);
    for (const name of ["x", "y", "c", "tab", "sort", "kind"]) parts.set(name, state[name]);
    parts.set("h", state.h.join(","));
    parts.set("p", state.p.join(","));
    if (!state.crop) parts.set("crop", "0");
    if (state.beside !== null) parts.set("beside", state.beside);
    if (state.tab === "compare") {
      for (const name of ["before", "after", "outcome"]) if (state[name]) parts.set(name, state[name]);
      for (const name of state.across) parts.append("across", name);
    }
    if (state.tab === "confusion") for (const name of ["fn", "cell"]) if (state[name]) parts.set(name, state[name]);
    return parts;
  };

  // The page.
  const options = (list, none) => [none ? h("option", { value: "" }, none) : null, ...Object.entries(GROUPS).map(([group, label]) => {
    const members = list.filter((one) => one.group === group);
    return members.length ? h("optgroup", { label }, members.map((one) => h("option", { value: one.name }, labelOf(one)))) : null;
  })];
  const pick = (id, label, list, name, none) => {
    const element = h("select", { id, "aria-label": label ? null : "Shown", on: { change: () => { state[name] = element.value; context = null; refresh(); } } }, options(list, none));
    element.value = state[name];
    return h("label", { class: "inline", for: id }, label, element);
  };
  const field = h("input", { type: "text", id: "where", class: "mono", value: state.where, placeholder: "distance_m > 25 and pacc < 0.5", autocomplete: "off", spellcheck: "false", list: "columns", on: { keydown: (event) => { if (event.key === "Enter") { state.where = field.value; refresh(); } }, change: () => { state.where = field.value; refresh(); } } });
  const wrong = h("p", { class: "note bad", role: "alert", hidden: true });
  const chips = h("div", { class: "row chips" });
  const selected = h("strong", { class: "number", "aria-live": "polite" });
  const scatter = scatterPlot({
    brushed: (a, b) => {
      state.brushes.set(state.x, a && { low: a[0], high: a[1], closed: true });
      state.brushes.set(state.y, b && { low: b[0], high: b[1], closed: true });
      refresh();
    },
    opened: async (number) => {
      const { items } = await get(`/v1/explore/rows?${new URLSearchParams([...base, ["number", number]])}`, { signal });
      if (items.length) location.hash = `#/frames/${items[0].frame_id}?view=errors`;
    },
  });
  const key = h("div", { class: "legend" });
  const lacking = h("p", { class: "small soft under" });
  const rates = h("div", {});
  const beside = h("select", { id: "beside", on: { change: () => { state.beside = beside.selectedIndex ? beside.value : null; remember(); loadRates(); } } });
  const histograms = h("div", { class: "histograms" });
  const parallel = parallelPlot({ brushed: (name, brush) => { state.brushes.set(name, brush); refresh(); } });
  const panel = h("div", {});
  const tools = h("div", { class: "row" });
  const tabs = h("div", { class: "segments", role: "group", "aria-label": "What the rows are shown as" }, Object.entries(TABS).map(([name, label]) =>
    h("button", { type: "button", "data-tab": name, on: { click: () => { state.tab = name; showPanel(); remember(); } } }, label)));
  const add = (id, label, names) => {
    const element = h("select", { id, on: { change: () => { if (element.value) { names().push(element.value); element.value = ""; context = null; refresh(); } } } }, h("option", { value: "" }, label), options(about.columns.filter(differs)).slice(1));
    return h("label", {}, h("span", { class: "visually-hidden" }, label), element);
  };
  const parallelColumns = h("div", { class: "row chips" });
  const below = h("section", { class: "card below", "aria-label": "Rows" }, h("div", { class: "head" }, tabs, tools), panel);
  const faults = h("div", { class: "stack", hidden: true }); // of pictures and functions, which rates and images below contain
  documents.filter((run) => run.state.startsWith("completed")).forEach((run) => get(`/v1/runs/${run.id}/summary`, { signal }).then(({ summary }) => { faults.append(...warningNotes(summary)); faults.hidden = !faults.childElementCount; }).catch(() => {}));
  const title = documents.length === 1 ? documents[0].name : plural(documents.length, "run");
  main.replaceChildren(
    h("div", { class: "stack" },
      h("p", { class: "crumbs" }, h("a", { href: "#/" }, "Runs"), " / ", documents.map((run, k) => [k ? ", " : "", h("a", { href: `#/runs/${run.id}` }, run.name)])),
      h("div", { class: "spread" }, h("h1", {}, `Explore ${title}`),
        h("div", { class: "row" },
          may("POST /v1/selections") ? h("button", { type: "button", on: { click: () => saveDialog() } }, "Save selection") : null,
          h("button", { type: "button", on: { click: () => savedDialog() } }, "Saved"),
          runs.length === 1 ? [
            Object.entries(CHILDREN).map(([form, [label, what]]) => h("button", { type: "button", title: what, on: { click: () => { location.hash = `#/new?${query({ form })}`; } } }, label)),
            h("button", { type: "button", on: { click: () => trainDialog() } }, "Train on this")] : h("span", { class: "small soft" }, "To refine or train, explore one run alone."),
          h("button", { type: "button", on: { click: () => exportDialog() } }, "Export")))),
    h("section", { class: "card select", "aria-label": "Selection" },
      h("div", { class: "row" }, h("label", { for: "where" }, "Where"), field, selected),
      h("datalist", { id: "columns" }, about.columns.map((one) => h("option", { value: one.name }))),
      chips, wrong),
    faults,
    h("div", { class: "explore-top" },
      h("section", { class: "card", "aria-label": "Scatter plot" }, h("div", { class: "head" }, pick("y", "", numeric, "y"), pick("x", "over", numeric, "x"), pick("c", "coloured by", about.columns.filter((one) => one.numeric || one.names.length <= 12), "c", "nothing")), scatter.element, h("div", { class: "legend under" }, key), lacking),
      h("section", { class: "card", "aria-label": "Rates" }, h("div", { class: "head" }, h("h2", {}, "Selection"), h("label", { class: "inline", for: "beside" }, "beside", beside)), rates)),
    h("section", { class: "card", "aria-label": "Histograms" }, h("div", { class: "head" }, h("h2", {}, "Histograms"), add("add-histogram", "Add a histogram…", () => state.h)), histograms),
    h("section", { class: "card", "aria-label": "Parallel coordinates" }, h("div", { class: "head" }, h("h2", {}, "Parallel coordinates"), add("add-axis", "Add an axis…", () => state.p)), parallel.element, parallelColumns),
    below);
  main.classList.add("wide");
  const blank = [scatter.element, histograms, parallel.element, panel]; // until the first rows are drawn
  const wait = (element) => element.setAttribute("aria-busy", "true"), shown = (element) => element.removeAttribute("aria-busy");
  [...blank, rates].forEach(wait);

  // Drawing.
  const drawn = new Map();
  signal.addEventListener("abort", () => { scatter.end(); parallel.end(); drawn.forEach((one) => one.end()); main.classList.remove("wide"); });
  const remember = () => history.replaceState(history.state, "", `#/explore?${address()}`);
  let context = null; // what is shown of all rows behind the selection
  const everything = () => {
    const all = new URLSearchParams(base);
    context ??= Promise.all([
      about.rows > 0 ? getBytes(`/v1/explore/scatter?${new URLSearchParams([...all, ["x", state.x], ["y", state.y], ["form", "cells"]])}`, { signal }).then(readArrow) : null,
      state.p.length > 1 ? get(`/v1/explore/links?${new URLSearchParams([...all, ...state.p.map((name) => ["column", name])])}`, { signal }) : { links: [] },
    ]);
    return context;
  };

  const drawHistograms = (found, whole) => {
    for (const name of [...drawn.keys()]) if (!state.h.includes(name)) { drawn.get(name).end(); drawn.delete(name); }
    for (const name of state.h) {
      if (!drawn.has(name)) {
        drawn.set(name, histogramPlot(columns.get(name), {
          brushed: (brush) => { state.brushes.set(name, brush); drawn.get(name).show(found_.get(name), brush, whole_); refresh(); },
          removed: () => { state.h = state.h.filter((one) => one !== name); state.brushes.set(name, null); refresh(); },
        }));
      }
    }
    put(histograms, state.h, state.h.map((name) => drawn.get(name).element));
    for (const name of state.h) drawn.get(name).show(found.get(name), state.brushes.of.get(name), whole);
  };
  let found_ = new Map(), whole_ = true;

  let busy = false, again = false;
  // One refresh at a time; what changes meanwhile is shown by the next.
  async function refresh() {
    if (busy) { again = true; return; }
    busy = true;
    try {
      do {
        again = false;
        remember();
        showChips();
        await update();
        wrong.hidden = true;
        field.removeAttribute("aria-invalid");
      } while (again && !signal.aborted);
    } catch (error) {
      if (error.name === "AbortError") return;
      if (error.status !== 422) throw error;
      shown(rates);
      wrong.textContent = error.message;
      wrong.hidden = false;
      field.setAttribute("aria-invalid", "true");
    } finally {
      busy = false;
      blank.forEach(shown);
    }
  }

  async function update() {
    const axes = [...new Set([...state.h, ...state.p])];
    const whole = !where();
    // The browser paints once, after all of them.
    const [bins, links, some, [all, every], showRows] = await Promise.all([
      get(`/v1/explore/histograms?${query({ column: axes })}`, { signal }),
      state.p.length > 1 ? get(`/v1/explore/links?${query({ column: state.p })}`, { signal }) : { links: [] },
      getBytes(`/v1/explore/scatter?${query({ x: state.x, y: state.y, color: state.c || null })}`, { signal }).then(readArrow),
      everything(),
      loadRows(),
    ]);
    if (signal.aborted) return;
    const found = new Map(bins.histograms.map((one) => [one.column, one]));
    found_ = found;
    whole_ = whole;
    selected.textContent = whole ? plural(bins.selected, "row") : `${count(bins.selected)} of ${plural(about.rows, "row")}`;
    scatter.show({ x: columns.get(state.x), y: columns.get(state.y), c: columns.get(state.c), all: whole ? null : all, some });
    put(key, [state.c], colorKey(columns.get(state.c)));
    const missing = Number(some.metadata.undefined);
    lacking.textContent = missing ? `${plural(missing, "row")} without ${titleOf(columns.get(state.x))} or ${titleOf(columns.get(state.y))} ${missing === 1 ? "is" : "are"} not drawn.` : "";
    drawHistograms(found, whole);
    parallel.show({ axes: state.p.map((name) => ({ ...found.get(name), column: columns.get(name), brush: state.brushes.of.get(name) })), links: links.links, every: every.links, whole });
    put(parallelColumns, state.p, state.p.map((name) => chip(titleOf(columns.get(name)), `Remove the axis ${titleOf(columns.get(name))}`, () => { state.p = state.p.filter((one) => one !== name); context = null; refresh(); })));
    const pictured = showRows?.();
    performance.mark("explore-shown"); // benchmarks/bench_explore.py measures by these marks
    pictured?.then(() => performance.mark("explore-pictured"));
    painted().then(loadRates);
  }

  const chip = (text, label, removed) => h("span", { class: "brush" }, text, h("button", { type: "button", class: "quiet close", "aria-label": label, on: { click: removed } }, "×"));
  const showChips = () => {
    const names = [...state.brushes.of.keys()];
    put(chips, [state.brushes.texts(), state.where], ...names.map((name) => {
      const brush = state.brushes.of.get(name), column = columns.get(name);
      const text = brush.undefined ? "is undefined" : brush.names ? brush.names.map((name) => textOf(column, name)).join(" or ") : brush.low === brush.high ? textOf(column, brush.low) : `${textOf(column, brush.low)} to ${textOf(column, brush.high)}`;
      return chip([h("b", {}, titleOf(column)), ` ${text}`], `Remove ${titleOf(column)} ${text}`, () => { state.brushes.set(name, null); refresh(); });
    }), names.length || state.where ? h("button", { type: "button", class: "quiet", on: { click: () => { state.brushes.of.clear(); state.where = field.value = ""; refresh(); } } }, "Clear all") : null);
  };

  let latest = 0, settle;
  const rated = new Promise((resolve) => { settle = resolve; });
  const loadRates = async () => {
    const mine = (latest += 1);
    try {
      const found = await get(`/v1/explore/rates?${query({ beside: state.beside })}`, { signal });
      if (mine !== latest) return;
      put(rates, [found, state.beside], ratesTable(found, about.rows, !where() && state.beside === null, beside.selectedOptions[0]?.textContent, runName));
      performance.mark("explore-rated");
    } catch (error) { if (error.name !== "AbortError" && mine === latest) toast(error.message); } finally { shown(rates); settle(); }
  };
  // What a selection can be compared with: the rest, and saved selections of these runs.
  const offerBeside = async () => {
    const saved = (await get("/v1/selections", { signal })).filter((one) => one.runs.every((id) => runs.includes(id)));
    const of = ({ runs: own, expression }) => (own.length === runs.length ? expression : [`(${own.map((id) => `run_id == '${id}'`).join(" or ")})`, expression && `(${expression})`].filter(Boolean).join(" and "));
    const others = new Map(saved.map((one) => [of(one), one.name]));
    if (state.beside !== null && !others.has(state.beside)) others.set(state.beside, state.beside || "all rows");
    beside.replaceChildren(h("option", {}, "the rest"), ...[...others].map(([expression, name]) => h("option", { value: expression, selected: expression === state.beside }, name)));
  };

  // Pictures, table, pairs.
  const parts = { get, signal, query, columns, several, state, runs, runName, about, remember, refresh };
  const panels = { pictures: picturesPanel(parts), table: tablePanel(parts), compare: comparisonPanel(parts), swings: swingsPanel(parts), confusion: confusionPanel(parts) };
  const loadRows = () => panels[state.tab].load(); // a panel draws by itself, or returns how to
  const showPanel = () => {
    for (const button of tabs.children) button.setAttribute("aria-pressed", String(button.dataset.tab === state.tab));
    tools.replaceChildren(...panels[state.tab].tools);
    panel.replaceChildren(panels[state.tab].element);
    if (!panels[state.tab].element.childElementCount) wait(panel);
    loadRows().finally(() => shown(panel)).then((show) => show?.()).catch((error) => { if (error.name !== "AbortError") toast(error.message); });
  };
  for (const button of tabs.children) button.setAttribute("aria-pressed", String(button.dataset.tab === state.tab));
  tools.replaceChildren(...panels[state.tab].tools);
  panel.replaceChildren(panels[state.tab].element);

  // Dialogs.
  const saveDialog = () => {
    const name = h("input", { type: "text", id: "selection-name", required: true, autofocus: true, maxlength: 120 });
    const save = async () => {
      if (!name.value.trim()) return;
      try {
        await post("/v1/selections", { name: name.value.trim(), runs, expression: where(), view: address().toString() });
        box.close();
        toast("The selection is saved.");
        await offerBeside();
      } catch (error) { toast(error.message); }
    };
    name.addEventListener("keydown", (event) => { if (event.key === "Enter") save(); });
    const box = dialog("Save the selection", h("p", { class: "soft small" }, where() || "all rows"), h("label", { for: "selection-name" }, "Name"), name,
      h("div", { class: "row" }, h("button", { type: "button", class: "primary", on: { click: save } }, "Save")));
  };
  const savedDialog = async () => {
    const [list, { items }] = await Promise.all([get("/v1/selections", { signal }), get("/v1/runs?limit=100", { signal })]);
    const box = dialog("Saved selections", savedList(list, [...documents, ...items], () => box.close()));
    box.classList.add("large");
  };
  const trainDialog = () => {
    const lines = documents[0].spec.functions.map((name) => command(reaching(`valerie train --from ${runs[0]} --function ${name} --where ${quoted(where() || "distance_m >= 0")}`)));
    dialog("Train on this", where() ? null : h("p", { class: "note wait" }, "Nothing is selected, so this trains on all persons. Select the rows where the function fails first."), h("p", { class: "soft small" }, "A new version of a function learns on fresh sites where the selected persons are: same distance, occlusion, size, heading and light, as far as the selection narrows them. It is registered and compared on the frames of this run.", isRemote() ? " The command runs on the server’s machine." : ""), lines).classList.add("large");
  };
  const exportDialog = () => {
    const stem = title.replaceAll(/[^\w.-]+/g, "-");
    const row = (label, what, address, name) => h("tr", {}, h("td", {}, h("button", { type: "button", on: { click: async (event) => {
      event.target.disabled = true;
      try { await download(address, name); } catch (error) { toast(error.message); } finally { event.target.disabled = false; }
    } } }, `↓ ${label}`)), h("td", { class: "small soft" }, what));
    dialog("Export", h("p", { class: "soft small" }, where() || "all rows"), table(["", ""], [
      row("CSV", "the rows", `/v1/explore/rows?${query({ format: "csv" })}`, `${stem}.csv`),
      row("Parquet", "the rows", `/v1/explore/rows?${query({ format: "parquet" })}`, `${stem}.parquet`),
      ...(runs.length === 1 ? Object.entries(DATASETS).map(([form, what]) => row(what[0], what[1], `/v1/explore/frames?${query({ format: form })}`, `${stem}-${form}.zip`)) : []),
    ], { caption: "Downloads of the selection" }), h("p", { class: "soft small" }, "Frames as a zip archive: up to 500. ", h("code", {}, "valerie dataset export"), " has no limit."));
  };
  await offerBeside();
  await refresh();
  if (parameters.has("show")) {
    // A link asks for this part of the page, which the rates above still move.
    const head = tabs.querySelector("[aria-pressed=true]");
    const land = () => below.scrollIntoView({ block: "start" });
    setTimeout(() => { head.focus({ preventScroll: true }); land(); });
    rated.then(() => { if (document.activeElement === head) land(); });
  }
  return `Explore ${title}`;
}

function dialog(title, ...content) {
  const box = h("dialog", { "aria-labelledby": "dialog-title", on: { close: () => box.remove() } }, h("div", { class: "stack" }, h("div", { class: "spread" }, h("h2", { id: "dialog-title" }, title), h("button", { type: "button", class: "quiet close", "aria-label": "Close", on: { click: () => box.close() } }, "×")), content));
  document.body.append(box);
  box.showModal();
  return box;
}

function savedList(list, known, opened) {
  const names = new Map(known.map((run) => [run.id, run.name]));
  if (!list.length) return h("p", { class: "soft" }, "None yet. Select rows, then save the selection under a name.");
  return table(["Name", "Runs", "Selection", "Saved", ""], list.map((one) => {
    const line = h("tr", {},
      h("td", {}, h("a", { href: `#/explore?${one.view}`, on: { click: opened } }, one.name)),
      h("td", { class: "small" }, one.runs.map((id, k) => [k ? ", " : "", h("a", { href: `#/runs/${id}`, title: id, on: { click: opened } }, names.get(id) ?? id)])),
      h("td", { class: "small mono" }, one.expression || "all rows"), h("td", { class: "small soft" }, ago(one.created_at)),
      h("td", { class: "right" }, may("DELETE /v1/selections/{name}") && h("button", { type: "button", class: "quiet close", "aria-label": `Delete ${one.name}`, on: { click: async () => { await remove(`/v1/selections/${encodeURIComponent(one.name)}`); line.remove(); } } }, "×")));
    return line;
  }), { caption: "Saved selections" });
}

// Without runs in the address: choose some, or a saved selection.
async function choose({ main, signal }) {
  const [{ items }, saved] = await Promise.all([get("/v1/runs?limit=100", { signal }), get("/v1/selections", { signal })]);
  const started = items.filter((run) => run.started_at);
  const picked = new Set();
  const go = h("button", { type: "button", class: "primary", disabled: true, on: { click: () => { location.hash = `#/explore?runs=${[...picked].join(",")}`; } } }, "Explore together");
  main.replaceChildren(h("h1", {}, "Explore"),
    h("section", { class: "card" }, h("div", { class: "head" }, h("h2", {}, "Runs"), started.length ? go : null),
      started.length ? table(["", "Run", "Variants", "Submitted"], started.map((run) => h("tr", {},
        h("td", {}, h("input", { type: "checkbox", "aria-label": `Choose ${run.name}`, on: { change: (event) => { if (event.target.checked) picked.add(run.id); else picked.delete(run.id); go.disabled = !picked.size; } } })),
        h("td", {}, h("a", { href: `#/explore?runs=${run.id}` }, run.name), h("div", { class: "small soft mono" }, run.id)),
        h("td", { class: "number" }, count(run.variant_count)), h("td", { class: "small soft" }, ago(run.created_at)))), { caption: "Runs" })
        : h("p", { class: "soft" }, "There is no run with results yet.")),
    h("section", { class: "card" }, h("h2", {}, "Saved selections"), savedList(saved, items, () => {})));
  return "Explore";
}

// Rates of the selection beside the rest.
function ratesTable({ groups, threshold, scored, selected, certainty }, rows, alone, other, runName) {
  const interval = (one) => (one.low === undefined ? h("div", { class: "small soft" }, one.units ? "no interval" : "") : h("div", { class: "small soft" }, `${fixed(100 * one.low)} to ${fixed(100 * one.high)} %`));
  const cell = (rate) => h("td", { class: "right" }, h("strong", {}, percent(rate.estimate)), interval(rate));
  const lacking = Map.groupBy(groups.filter(({ selected: one }) => one.why), ({ selected: one }) => one.why); // reason to groups
  const which = (some) => (some.length < groups.length ? ` for ${[...new Set(some.map((one) => runName(one.run)))].join(", ")}` : "");
  const several = new Set(groups.map((one) => one.run)).size > 1, sensors = new Set(groups.map((one) => one.sensor)).size > 1;
  const lines = groups.flatMap((group) => [["selection", group.selected], ["rest", group.beside]].slice(0, alone ? 1 : 2).map(([side, one], k) =>
    h("tr", { class: side }, h("th", { scope: "row" }, k ? h("span", { class: "visually-hidden" }, group.function) : [h("div", {}, group.function), several || sensors ? h("div", { class: "small soft" }, [several ? runName(group.run) : "", sensors ? group.sensor : ""].filter(Boolean).join(" · ")) : null], h("div", { class: "small soft" }, k ? other : selected < rows ? "selection" : "all rows")),
      h("td", { class: "right number" }, count(one.persons), h("div", { class: "small soft", title: Object.entries(one.undefined).map(([why, n]) => `${count(n)} ${why}`).join(", ") }, `${count(Object.values(one.undefined).reduce((a, b) => a + b, 0))} undefined`)), cell(one.pacc), cell(one.detected))));
  return [table(["", { text: "Persons", class: "right" }, { text: "Mean pACC", class: "right" }, { text: `pACC ≥ ${fixed(threshold, 2)}`, class: "right", title: "detection rate" }], lines, { caption: "Rates of the selection and what is beside it" }),
    scored && selected < rows ? h("p", { class: "small soft under" }, "The selection depends on scores, so these rates repeat what was asked for.") : null,
    certainty.length ? h("p", { class: "small soft under" }, certainty.join(" ")) : null,
    [...lacking].map(([why, some]) => h("p", { class: "small soft under" }, `No confidence interval${which(some)}: ${why}.`))];
}

function sortTool({ state, columns, remember }, reload, id) {
  const common = [["pacc", "worst first"], ["-pacc", "best first"], ["", "in order"]];
  const element = h("select", { id, on: { change: () => { state.sort = element.value; remember(); reload(); } } },
    common.map(([value, text]) => h("option", { value }, text)),
    [...columns.values()].filter((one) => one.name !== "pacc").flatMap((one) => [["", "↑"], ["-", "↓"]].map(([sign, arrow]) => h("option", { value: sign + one.name }, `${labelOf(one)} ${arrow}`))));
  element.value = state.sort;
  return h("label", { class: "inline", for: id }, "Sort", element);
}

function picturesPanel(parts) {
  const { get, signal, query, columns, several, state, remember } = parts;
  const grid = thumbnails({ signal });
  const more = h("button", { type: "button", hidden: true, on: { click: () => show(true) } }, "Show more");
  let offset = 0;
  const load = async (further) => {
    offset = further ? offset + PAGE : 0;
    const { items, selected } = await get(`/v1/explore/rows?${query({ sort: state.sort, limit: PAGE, offset })}`, { signal });
    const second = columns.get(state.sort.replace("-", ""));
    return () => {
      more.hidden = offset + items.length >= selected;
      return grid.show(items, { kind: state.kind, crop: state.crop, further, caption: (row) => [`pACC ${textOf(columns.get("pacc") ?? { scale: 100, unit: "%", digits: 1 }, row.pacc)}`, [second && second.name !== "pacc" ? textOf(second, row[second.name]) : row.distance_m === null ? "" : textOf(columns.get("distance_m"), row.distance_m), several.includes("function") ? row.function : ""].filter(Boolean).join(", ")] });
    };
  };
  const show = async (further) => { (await load(further))(); };
  const kinds = h("div", { class: "segments", role: "group", "aria-label": "Kind of picture" }, Object.entries(KINDS).map(([kind, label]) => h("button", { type: "button", "data-kind": kind, "aria-pressed": String(kind === state.kind), on: { click: () => { state.kind = kind; for (const one of kinds.children) one.setAttribute("aria-pressed", String(one.dataset.kind === kind)); remember(); show(); } } }, label)));
  const crop = h("input", { type: "checkbox", checked: state.crop, on: { change: () => { state.crop = crop.checked; remember(); show(); } } });
  return { element: h("div", { class: "stack" }, errorLegend(), grid.element, h("div", { class: "row centre" }, more)), tools: [kinds, h("label", { class: "inline" }, crop, "Crop to person"), sortTool(parts, show, "sort-pictures")], load };
}

function tablePanel(parts) {
  const { get, signal, query, columns, state } = parts;
  const element = h("div", {});
  const load = async () => {
    const { items } = await get(`/v1/explore/rows?${query({ sort: state.sort, limit: PAGE })}`, { signal });
    const names = [...new Set(["function", "pacc", state.y, state.x, ...(state.c ? [state.c] : []), ...state.h, ...state.p])].filter((name) => columns.has(name)).map((name) => columns.get(name));
    return () => element.replaceChildren(table(["Frame", ...names.map((one) => ({ text: labelOf(one), class: one.numeric ? "right" : null }))], items.map((row) => h("tr", {},
      h("td", {}, h("a", { class: "mono", href: `#/frames/${row.frame_id}?view=errors` }, row.frame_id.split(".").slice(1).join("."))),
      names.map((one) => h("td", { class: one.numeric ? "right" : null }, one.numeric && row[one.name] === null ? h("span", { class: "soft" }, "–") : textOf({ ...one, unit: "" }, row[one.name]))))), { caption: "Selected rows" }));
  };
  return { element, tools: [sortTool(parts, async () => (await load())(), "sort-table")], load };
}
