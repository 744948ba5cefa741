// The runs that descend from each other, as a graph: one column for each generation, one box for each run.
import { h, s } from "./dom.js";
import { ago, look, words } from "./format.js";

const BOX = { width: 190, height: 46 };
const GAP = { x: 56, y: 14 };
const LONGEST = 24; // characters of a name

export function lineageSection(relatives, key) {
  if (relatives.length < 2) return null;
  const known = new Map(relatives.map((one) => [one.id, { ...one, children: [] }]));
  const roots = [];
  for (const one of known.values()) (known.get(one.parent_run)?.children ?? roots).push(one);
  let row = 0;
  let depth = 0;
  const place = (one, column) => {
    depth = Math.max(depth, column);
    one.x = column * (BOX.width + GAP.x);
    one.children.forEach((child) => place(child, column + 1));
    // Beside its children; a run without any takes the next row.
    one.y = one.children.length ? (one.children[0].y + one.children[one.children.length - 1].y) / 2 : row++ * (BOX.height + GAP.y);
  };
  roots.forEach((one) => place(one, 0));
  const nodes = [...known.values()];
  const width = (depth + 1) * (BOX.width + GAP.x) - GAP.x, height = row * (BOX.height + GAP.y) - GAP.y;
  const lines = nodes.flatMap((one) => one.children.map((child) => {
    const from = one.x + BOX.width, middle = from + GAP.x / 2, y = one.y + BOX.height / 2, end = child.y + BOX.height / 2;
    return s("path", { d: `M ${from} ${y} C ${middle} ${y} ${middle} ${end} ${child.x} ${end}`, class: "descent" });
  }));
  const short = (name) => (name.length > LONGEST ? `${name.slice(0, LONGEST - 1)}…` : name);
  const boxes = nodes.map((one) => s("a", { href: `#/runs/${one.id}`, "aria-label": `${one.name}, ${words(one.state)}${one.id === key ? ", this run" : ""}`, "aria-current": one.id === key ? "true" : null, class: `relative ${look(one.state)}` },
    s("title", {}, `${one.name} · ${one.id}`),
    s("rect", { x: one.x, y: one.y, width: BOX.width, height: BOX.height, rx: 7 }),
    s("circle", { cx: one.x + 14, cy: one.y + 17, r: 4 }),
    s("text", { x: one.x + 25, y: one.y + 21 }, short(one.name)),
    s("text", { x: one.x + 25, y: one.y + 37, class: "minor" }, `${words(one.state)} · ${ago(one.created_at)}`)));
  const studies = [...new Set(nodes.map((one) => one.study).filter(Boolean))];
  return h("section", { class: "card", "aria-label": "Lineage" }, h("h2", {}, "Lineage"),
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Graph of runs" },
      s("svg", { class: "lineage", width: width + 4, height: height + 4, viewBox: `-2 -2 ${width + 4} ${height + 4}`, role: "group", "aria-label": "Runs that descend from each other, oldest left" }, lines, boxes)),
    studies.length ? h("p", { class: "small soft under" }, "Batches of ", studies.map((id, i) => [i ? ", " : "", h("a", { href: `#/studies/${id}`, class: "mono" }, id)])) : null);
}
