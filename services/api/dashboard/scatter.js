// Scatter plot of pACC over one column, one panel per function, on a canvas that mouse, touch and keyboard can explore.
import { get } from "./api.js";
import { h, put } from "./dom.js";
import { NONE, count, fixed, heading, percent, plural } from "./format.js";

const FIRST = "distance_m";
const GROUPS = { person: "Of the person", conditions: "Moment and weather", varied: "Varied" };
const SHAPES = ["circle", "diamond", "square", "triangle", "cross", "ring"];
const PAD = { left: 46, right: 14, top: 12, bottom: 42 };
const BINS = 8;
const FEWEST = 5;

export function scatterSection({ path, parameters, signal }) {
  let column = parameters.get("x") ?? FIRST;
  const panels = h("div", { class: "panels" });
  const legend = h("div", { class: "legend" });
  const note = h("p", { class: "small soft under" });
  const axis = h("select", { id: "axis", on: { change: () => { column = axis.value; history.replaceState(history.state, "", `${location.hash.split("?")[0]}?${new URLSearchParams({ x: column })}`); load(); } } });
  const element = h("section", { class: "card", hidden: true },
    h("div", { class: "head" }, h("h2", {}, "pACC of every person"), legend, h("label", { class: "inline", for: "axis" }, "pACC over", axis)), panels, note);
  let drawn = [];

  // The address may name an axis that this run does not have.
  const ask = async () => {
    const of = (name) => get(`${path}/points?${new URLSearchParams({ column: name })}`, { signal });
    try {
      return await of(column);
    } catch (error) {
      if (error.status !== 422 || column === FIRST) throw error;
      column = FIRST;
      return of(column);
    }
  };
  const offer = (axes) => {
    put(axis, axes, Object.entries(GROUPS).map(([group, label]) => {
      const members = axes.filter((one) => one.group === group).map(axisOf);
      return members.length ? h("optgroup", { label }, members.map((one) => h("option", { value: one.column }, one.label))) : null;
    }));
    axis.value = column;
  };

  const load = async (evaluated) => {
    if (evaluated === 0) { element.hidden = true; return; }
    const data = await ask();
    const shown = axisOf(data.axes.find((one) => one.column === column));
    offer(data.axes);
    element.hidden = false;
    // The same order as in the report, so that colours agree.
    const characters = [...data.characters].sort();
    const styleOf = data.characters.map((name) => characters.indexOf(name));
    legend.replaceChildren(...characters.map((name, i) => h("span", { class: "key" }, swatch(i), name)),
      h("span", { class: "key" }, h("span", { class: "mean-key" }), "binned mean"));
    const groups = new Map();
    data.x.forEach((_, i) => {
      const name = `${data.functions[data.function[i]]}${data.sensors.length > 1 ? ` · ${data.sensors[data.sensor[i]]}` : ""}`;
      if (!groups.has(name)) groups.set(name, []);
      groups.get(name).push(i);
    });
    const names = [...groups.keys()].sort();
    const range = extent(data.x.map((x) => x * shown.scale));
    if (drawn.map((one) => one.name).join() !== names.join()) {
      drawn.forEach((one) => one.end());
      drawn = names.map((name) => panel(name, path));
      panels.replaceChildren(...(drawn.length ? drawn.map((one) => one.element) : [h("p", { class: "soft" }, "No person with a defined pACC yet.")]));
    }
    drawn.forEach((one) => one.show({ data, rows: groups.get(one.name), axis: shown, range, styleOf, characters }));
    const gaps = Object.entries(data.undefined);
    note.textContent = [
      "Each point is one person in one frame. Choose a point to open its frame.",
      data.share < 1 ? `The plot shows an even sample of ${percent(data.share, 0)} of the variants.` : "",
      gaps.length ? `Not drawn, since their pACC is undefined: ${gaps.map(([why, n]) => `${count(n)} ${why}`).join(", ")}.` : "",
    ].join(" ");
  };
  signal.addEventListener("abort", () => drawn.forEach((one) => one.end()));
  return { element, load };
}

// Title and label of an axis: Distance (m). Parameters keep their names.
function axisOf(one) {
  const title = one.group === "varied" ? one.title : heading(one.title);
  return { ...one, title, label: one.unit ? `${title} (${one.unit})` : title };
}

function extent(values) {
  if (!values.length) return [0, 1];
  let low = Infinity, high = -Infinity;
  for (const one of values) { if (one < low) low = one; if (one > high) high = one; }
  const pad = (high - low || Math.abs(high) || 1) * 0.04;
  return [low >= 0 ? Math.max(0, low - pad) : low - pad, high + pad];
}

function ticks([low, high], wanted = 6) {
  const rough = (high - low) / wanted;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough);
  const values = [];
  for (let i = Math.ceil(low / step); i * step <= high + 1e-9; i += 1) values.push(Number((i * step).toPrecision(10)));
  return values;
}

function swatch(i) {
  const canvas = h("canvas", { width: 28, height: 28, "aria-hidden": "true" });
  const context = canvas.getContext("2d");
  requestAnimationFrame(() => mark(context, SHAPES[i % 6], 14, 14, 8, color(canvas, `--series-${(i % 6) + 1}`)));
  return canvas;
}

const color = (element, name) => getComputedStyle(element).getPropertyValue(name).trim();

function mark(context, shape, x, y, size, fill, alpha = 1) {
  context.globalAlpha = alpha;
  context.fillStyle = context.strokeStyle = fill;
  context.beginPath();
  if (shape === "circle" || shape === "ring") context.arc(x, y, size, 0, 7);
  else if (shape === "diamond") { context.moveTo(x, y - size * 1.25); context.lineTo(x + size * 1.25, y); context.lineTo(x, y + size * 1.25); context.lineTo(x - size * 1.25, y); }
  else if (shape === "square") context.rect(x - size * 0.9, y - size * 0.9, size * 1.8, size * 1.8);
  else if (shape === "triangle") { context.moveTo(x, y - size * 1.2); context.lineTo(x + size * 1.1, y + size * 0.8); context.lineTo(x - size * 1.1, y + size * 0.8); }
  else { context.rect(x - size * 0.35, y - size * 1.1, size * 0.7, size * 2.2); context.rect(x - size * 1.1, y - size * 0.35, size * 2.2, size * 0.7); }
  context.closePath();
  if (shape === "ring") { context.lineWidth = 1.5; context.stroke(); } else context.fill();
  context.globalAlpha = 1;
}

function panel(name, path) {
  const run = path.split("/").pop();
  const canvas = h("canvas", { tabindex: "0", role: "img" });
  const tip = h("div", { class: "tip", hidden: true });
  const live = h("p", { class: "visually-hidden", "aria-live": "polite" });
  const mean = h("span", { class: "soft number" });
  const element = h("figure", {}, h("figcaption", {}, h("h3", {}, name), mean), h("div", { class: "plot" }, canvas, tip), live);
  let now = null;
  let points = [];
  let chosen = -1;

  const frameOf = (i) => `${run}.${now.data.variant[i]}.${now.data.camera[i]}.${now.data.time[i]}`;
  const open = () => { if (chosen >= 0) location.hash = `#/frames/${frameOf(points[chosen].i)}?view=prediction`; };

  const draw = () => {
    const width = canvas.clientWidth, height = canvas.clientHeight, ratio = devicePixelRatio || 1;
    if (!now || !width) return;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const { data, rows, axis, range, styleOf } = now;
    const toX = (x) => PAD.left + ((x - range[0]) / (range[1] - range[0])) * (width - PAD.left - PAD.right);
    const toY = (pacc) => height - PAD.bottom - pacc * (height - PAD.top - PAD.bottom);
    const ink = color(canvas, "--soft"), line = color(canvas, "--line");
    context.font = "12px system-ui, sans-serif";
    context.fillStyle = ink;
    context.strokeStyle = line;
    context.lineWidth = 1;
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (let share = 0; share <= 100; share += 20) {
      const y = Math.round(toY(share / 100)) + 0.5;
      context.beginPath(); context.moveTo(PAD.left, y); context.lineTo(width - PAD.right, y); context.stroke();
      context.fillText(String(share), PAD.left - 8, y);
    }
    context.textAlign = "center";
    context.textBaseline = "top";
    for (const tick of ticks(range, Math.max(3, Math.round(width / 90)))) context.fillText(String(tick), toX(tick), height - PAD.bottom + 9);
    context.fillText(axis.label, PAD.left + (width - PAD.left - PAD.right) / 2, height - 16);
    context.save();
    context.translate(12, PAD.top + (height - PAD.top - PAD.bottom) / 2);
    context.rotate(-Math.PI / 2);
    context.textBaseline = "middle";
    context.fillText("pACC (%)", 0, 0);
    context.restore();

    const faint = rows.length > 3000 ? 0.2 : rows.length > 600 ? 0.38 : 0.62;
    const size = rows.length > 3000 ? 2.2 : 3.2;
    points = rows.map((i) => ({ i, x: toX(data.x[i] * axis.scale), y: toY(data.pacc[i]) })).sort((a, b) => a.x - b.x || a.y - b.y);
    for (const point of points) {
      const style = Math.max(0, styleOf[data.character[point.i]] ?? 0);
      mark(context, SHAPES[style % 6], point.x, point.y, size, color_(style), faint);
    }
    const bins = means(rows.map((i) => [data.x[i] * axis.scale, data.pacc[i]]), range);
    const strong = color(canvas, "--mean");
    context.strokeStyle = strong;
    context.lineWidth = 2;
    context.beginPath();
    bins.forEach(([x, y], k) => (k ? context.lineTo(toX(x), toY(y)) : context.moveTo(toX(x), toY(y))));
    context.stroke();
    for (const [x, y] of bins) {
      context.fillStyle = color(canvas, "--card");
      context.fillRect(toX(x) - 3.5, toY(y) - 3.5, 7, 7);
      context.strokeRect(toX(x) - 3.5, toY(y) - 3.5, 7, 7);
    }
    if (chosen >= 0 && points[chosen]) {
      const point = points[chosen];
      context.strokeStyle = color(canvas, "--ink");
      context.lineWidth = 2;
      context.beginPath(); context.arc(point.x, point.y, 8, 0, 7); context.stroke();
      const { i } = point;
      const text = [
        `${data.characters[data.character[i]] ?? "person"} · pACC ${percent(data.pacc[i])}`,
        `${axis.title} ${fixed(data.x[i] * axis.scale, axis.unit === "pixels" ? 0 : 2)} ${axis.unit}`,
        `variant ${data.variant[i]}, ${data.cameras[data.camera[i]]}`,
      ];
      tip.replaceChildren(...text.map((one) => h("div", {}, one)));
      tip.hidden = false;
      const left = point.x > width / 2;
      tip.style.setProperty("left", left ? "auto" : `${point.x + 14}px`);
      tip.style.setProperty("right", left ? `${width - point.x + 14}px` : "auto");
      tip.style.setProperty("top", `${Math.max(4, Math.min(point.y - 20, height - 90))}px`);
    } else tip.hidden = true;
  };
  const color_ = (style) => color(canvas, `--series-${(style % 6) + 1}`);

  const choose = (k, say = false) => {
    if (k === chosen) return;
    chosen = k;
    canvas.classList.toggle("aimed", k >= 0);
    draw();
    if (say && k >= 0) live.textContent = tip.textContent;
  };
  canvas.addEventListener("pointermove", (event) => {
    const box = canvas.getBoundingClientRect();
    const x = event.clientX - box.left, y = event.clientY - box.top;
    let best = -1, nearest = 14 ** 2;
    points.forEach((point, k) => { const d = (point.x - x) ** 2 + (point.y - y) ** 2; if (d < nearest) { nearest = d; best = k; } });
    choose(best);
  });
  canvas.addEventListener("pointerleave", () => choose(-1));
  canvas.addEventListener("click", open);
  canvas.addEventListener("blur", () => choose(-1));
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1, PageDown: 10, PageUp: -10 }[event.key];
    if (step && points.length) { event.preventDefault(); choose(Math.max(0, Math.min(points.length - 1, chosen + step)), true); }
    else if (event.key === "Enter") open();
    else if (event.key === "Escape") choose(-1);
  });
  const resize = new ResizeObserver(draw);
  resize.observe(canvas);
  const theme = matchMedia("(prefers-color-scheme: dark)");
  theme.addEventListener("change", draw);

  return {
    name, element,
    show(given) {
      now = given;
      chosen = -1;
      const values = given.rows.map((i) => given.data.pacc[i]);
      const average = values.length ? values.reduce((sum, one) => sum + one, 0) / values.length : null;
      mean.textContent = `mean ${average === null ? NONE : percent(average)} of ${plural(values.length, "person-frame")}`;
      canvas.setAttribute("aria-label", `${name}: pACC over ${given.axis.title}, ${mean.textContent}. Arrow keys choose a point, Enter opens its frame.`);
      draw();
    },
    end() { resize.disconnect(); theme.removeEventListener("change", draw); },
  };
}

// Means of equally wide bins with at least FEWEST points.
function means(values, [low, high]) {
  const bins = Array.from({ length: BINS }, () => [0, 0, 0]);
  for (const [x, y] of values) {
    const bin = bins[Math.min(BINS - 1, Math.floor(((x - low) / (high - low)) * BINS))];
    bin[0] += x; bin[1] += y; bin[2] += 1;
  }
  return bins.filter(([, , n]) => n >= FEWEST).map(([x, y, n]) => [x / n, y / n]);
}
