// Drawings of the page Explore on canvases: scatter or density, histogram, parallel coordinates.
import { h } from "./dom.js";
import { count, heading, shown } from "./format.js";
import { binsOfBrush, brushOfBins } from "./selection.js";

const PAD = { left: 54, right: 14, top: 10, bottom: 40 };
const SERIES = 6;
//: Viridis at nine places (CC0, by van der Walt and Smith): equal steps of a value look equally far apart to everyone.
const RAMP = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];

const color = (element, name) => getComputedStyle(element).getPropertyValue(name).trim();
export const titleOf = (column) => (column.group === "varied" ? column.title : heading(column.title));
export const labelOf = (column) => (column.unit ? `${titleOf(column)} (${column.unit})` : titleOf(column));
export function textOf(column, value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "undefined";
  if (typeof value !== "number") return column.nameOf?.(value) ?? String(value);
  const digits = column.digits ?? (Math.abs(value) >= 100 ? 1 : 2);
  return shown({ ...column, digits: Number.isInteger(value * column.scale) ? 0 : digits }, value);
}

function ticks(low, high, wanted) {
  const rough = (high - low) / wanted || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 2.5, 5, 10].map((one) => one * power).find((one) => one >= rough * 0.999);
  const values = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9; k += 1) values.push(Number((k * step).toPrecision(10)));
  return values;
}

// A canvas that is as sharp as the screen; `draw(context, width, height)` is called when its size or the colours change.
function surface(draw, properties) {
  const canvas = h("canvas", properties);
  const paint = () => {
    const width = canvas.clientWidth, height = canvas.clientHeight, ratio = devicePixelRatio || 1;
    if (!width || !height) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = "12px system-ui, sans-serif";
    draw(context, width, height);
  };
  const resize = new ResizeObserver(paint);
  resize.observe(canvas);
  const theme = matchMedia("(prefers-color-scheme: dark)");
  theme.addEventListener("change", paint);
  return { canvas, paint, end() { resize.disconnect(); theme.removeEventListener("change", paint); } };
}

// Follow a pointer from press to release; `moved(from, to, ended)` in canvas coordinates.
function dragging(canvas, moved) {
  const place = (event) => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    const from = place(event);
    canvas.setPointerCapture(event.pointerId);
    const move = (now) => moved(from, place(now), false);
    const end = (now) => {
      canvas.removeEventListener("pointermove", move);
      canvas.removeEventListener("pointerup", end);
      canvas.removeEventListener("pointercancel", end);
      moved(from, place(now), true);
    };
    canvas.addEventListener("pointermove", move);
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
  });
}

const ramp = Array.from({ length: 64 }, (_, k) => {
  const place = (k / 63) * (RAMP.length - 1), i = Math.min(RAMP.length - 2, Math.floor(place)), part = place - i;
  const channel = (hex, at) => parseInt(hex.slice(at, at + 2), 16);
  return `rgb(${[1, 3, 5].map((at) => Math.round(channel(RAMP[i], at) * (1 - part) + channel(RAMP[i + 1], at) * part)).join(" ")})`;
});

// Scatter or density of two columns. `brushed(x, y)` gets [low, high] of both, or nulls; `opened(row)` a point's row.
export function scatterPlot({ brushed, opened }) {
  let data = null, frame = null, chosen = -1, places = [];
  const tip = h("div", { class: "tip", hidden: true });
  const view = surface((context, width, height) => draw(context, width, height), { class: "scatter-canvas", tabindex: "0", role: "img", "aria-label": "Scatter plot" });
  const { canvas } = view;
  const live = h("p", { class: "visually-hidden", "aria-live": "polite" });
  const element = h("div", { class: "plot" }, canvas, tip, live);

  // The cells of a density as a picture, a pixel each: it is drawn once and then stretched.
  const pictures = new WeakMap();
  function pictured(table, fill, w, k) {
    const key = color(canvas, "--card"); // of the theme
    if (pictures.get(table)?.key === key) return pictures.get(table);
    const { x, y, count } = table.columns;
    const [x0, x1, y0, y1] = [Math.min(...x), Math.max(...x), Math.min(...y), Math.max(...y)];
    const picture = new OffscreenCanvas(table.rows ? Math.round((x1 - x0) / w) + 1 : 1, table.rows ? Math.round((y1 - y0) / k) + 1 : 1);
    const context = picture.getContext("2d"), most = count.reduce((a, b) => Math.max(a, b), 1);
    for (let i = 0; i < table.rows; i += 1) {
      context.globalAlpha = 0.12 + 0.88 * (Math.log1p(count[i]) / Math.log1p(most));
      context.fillStyle = fill(i);
      context.fillRect(Math.round((x[i] - x0) / w), Math.round((y1 - y[i]) / k), 1, 1);
    }
    const answer = { key, picture, left: x0 - w / 2, top: y1 + k / 2 };
    pictures.set(table, answer);
    return answer;
  }

  const range = (column) => {
    const low = column.low ?? 0, high = column.high ?? 1, pad = (high - low || Math.abs(high) || 1) * 0.02;
    return [low - pad, high + pad];
  };

  function draw(context, width, height) {
    if (!data) return;
    const { x, y, all, some } = data, [x0, x1] = range(x), [y0, y1] = range(y);
    const toX = (value) => PAD.left + ((value - x0) / (x1 - x0)) * (width - PAD.left - PAD.right);
    const toY = (value) => height - PAD.bottom - ((value - y0) / (y1 - y0)) * (height - PAD.top - PAD.bottom);
    data.fromX = (place) => x0 + ((place - PAD.left) / (width - PAD.left - PAD.right)) * (x1 - x0);
    data.fromY = (place) => y0 + ((height - PAD.bottom - place) / (height - PAD.top - PAD.bottom)) * (y1 - y0);
    const soft = color(canvas, "--soft"), line = color(canvas, "--line"), pale = color(canvas, "--line-strong");
    context.lineWidth = 1;
    context.strokeStyle = line;
    context.fillStyle = soft;
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const tick of ticks(y0 * y.scale, y1 * y.scale, Math.max(3, height / 64))) {
      const at = Math.round(toY(tick / y.scale)) + 0.5;
      if (at < PAD.top || at > height - PAD.bottom) continue;
      context.beginPath(); context.moveTo(PAD.left, at); context.lineTo(width - PAD.right, at); context.stroke();
      context.fillText(tick.toLocaleString("en"), PAD.left - 8, at);
    }
    context.textAlign = "center";
    context.textBaseline = "top";
    for (const tick of ticks(x0 * x.scale, x1 * x.scale, Math.max(3, width / 90))) context.fillText(tick.toLocaleString("en"), toX(tick / x.scale), height - PAD.bottom + 8);
    context.fillText(labelOf(x), PAD.left + (width - PAD.left - PAD.right) / 2, height - 16);
    context.save();
    context.translate(13, PAD.top + (height - PAD.top - PAD.bottom) / 2);
    context.rotate(-Math.PI / 2);
    context.textBaseline = "middle";
    context.fillText(labelOf(y), 0, 0);
    context.restore();

    const cells = (table, fill) => {
      const w = Number(table.metadata.width), k = Number(table.metadata.height);
      const { picture, left, top } = pictured(table, fill, w, k);
      context.imageSmoothingEnabled = false;
      context.drawImage(picture, toX(left), toY(top), picture.width * (toX(w) - toX(0)), picture.height * (toY(0) - toY(k)));
    };
    if (all) cells(all, () => pale);
    if (some) {
      const paint = shades(some);
      if (some.metadata.form === "cells") { cells(some, paint); places = []; } else {
        const size = some.rows > 5000 ? 2 : some.rows > 800 ? 3 : 5;
        context.globalAlpha = some.rows > 5000 ? 0.55 : 0.85;
        places = new Float32Array(2 * some.rows);
        for (let i = 0; i < some.rows; i += 1) {
          places[2 * i] = toX(some.columns.x[i]);
          places[2 * i + 1] = toY(some.columns.y[i]);
          context.fillStyle = paint(i);
          context.fillRect(places[2 * i] - size / 2, places[2 * i + 1] - size / 2, size, size);
        }
        context.globalAlpha = 1;
      }
    }
    context.strokeStyle = color(canvas, "--accent");
    if (frame) {
      context.fillStyle = color(canvas, "--accent-soft");
      context.globalAlpha = 0.35;
      context.fillRect(...frame);
      context.globalAlpha = 1;
      context.strokeRect(...frame);
    }
    if (chosen >= 0 && 2 * chosen < places.length) {
      context.lineWidth = 2;
      context.strokeStyle = color(canvas, "--ink");
      context.beginPath(); context.arc(places[2 * chosen], places[2 * chosen + 1], 7, 0, 7); context.stroke();
      const rows = [`${titleOf(x)} ${textOf(x, some.columns.x[chosen])}`, `${titleOf(y)} ${textOf(y, some.columns.y[chosen])}`];
      if (data.c) rows.push(`${titleOf(data.c)} ${data.c.numeric ? textOf(data.c, some.columns.color[chosen]) : data.c.names[some.columns.color[chosen]] ?? "undefined"}`);
      tip.replaceChildren(...rows.map((row) => h("div", {}, row)));
      tip.hidden = false;
      const left = places[2 * chosen] > width / 2;
      tip.style.setProperty("left", left ? "auto" : `${places[2 * chosen] + 14}px`);
      tip.style.setProperty("right", left ? `${width - places[2 * chosen] + 14}px` : "auto");
      tip.style.setProperty("top", `${Math.max(4, Math.min(places[2 * chosen + 1] - 20, height - 90))}px`);
    } else tip.hidden = true;
  }

  function shades(table) {
    const { c } = data;
    if (!c || !table.columns.color) { const accent = color(canvas, "--accent"); return () => accent; }
    const none = color(canvas, "--line-strong");
    if (!c.numeric) {
      const series = Array.from({ length: SERIES }, (_, k) => color(canvas, `--series-${k + 1}`));
      return (i) => (Number.isNaN(table.columns.color[i]) ? none : series[table.columns.color[i] % SERIES]);
    }
    const low = c.low ?? 0, width = (c.high ?? 1) - low || 1;
    return (i) => (Number.isNaN(table.columns.color[i]) ? none : ramp[Math.max(0, Math.min(63, Math.round(((table.columns.color[i] - low) / width) * 63)))]);
  }

  const choose = (k, say) => { if (k !== chosen) { chosen = k; canvas.classList.toggle("aimed", k >= 0); view.paint(); if (say && k >= 0) live.textContent = tip.textContent; } };
  const nearest = (px, py) => {
    let best = -1, least = 12 ** 2;
    for (let i = 0; 2 * i < places.length; i += 1) { const d = (places[2 * i] - px) ** 2 + (places[2 * i + 1] - py) ** 2; if (d < least) { least = d; best = i; } }
    return best;
  };
  canvas.addEventListener("pointermove", (event) => { if (!event.buttons) { const box = canvas.getBoundingClientRect(); choose(nearest(event.clientX - box.left, event.clientY - box.top)); } });
  canvas.addEventListener("pointerleave", () => choose(-1));
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1, PageDown: 20, PageUp: -20 }[event.key];
    if (step && places.length) { event.preventDefault(); choose(Math.max(0, Math.min(places.length / 2 - 1, chosen + step)), true); }
    else if (event.key === "Enter" && chosen >= 0) opened(data.some.columns.row[chosen]);
    else if (event.key === "Escape") { choose(-1); frame = null; brushed(null, null); }
  });
  dragging(canvas, ([ax, ay], [bx, by], ended) => {
    if (!data?.fromX) return;
    const far = Math.hypot(bx - ax, by - ay) > 5;
    if (!far) {
      if (!ended) return;
      const point = nearest(bx, by);
      if (point >= 0) opened(data.some.columns.row[point]);
      else { frame = null; brushed(null, null); }
      return;
    }
    frame = [Math.min(ax, bx), Math.min(ay, by), Math.abs(bx - ax), Math.abs(by - ay)];
    view.paint();
    if (ended) {
      // A frame may reach beyond the values.
      const ends = ({ low, high }, ...values) => values.map((value) => Math.max(low, Math.min(high, Number(value.toPrecision(4)))));
      brushed(ends(data.x, data.fromX(frame[0]), data.fromX(frame[0] + frame[2])), ends(data.y, data.fromY(frame[1] + frame[3]), data.fromY(frame[1])));
      frame = null;
    }
  });
  return {
    element, end: view.end,
    show(given) {
      data = { ...data, ...given };
      chosen = -1;
      places = [];
      canvas.setAttribute("aria-label", `${titleOf(data.y)} over ${titleOf(data.x)}: drag to select an area, arrow keys choose a point, Enter opens its frame`);
      view.paint();
    },
  };
}

// The key of the colours of a scatter plot.
export function colorKey(c) {
  if (!c) return [];
  if (c.numeric) {
    return [h("span", { class: "key" }, textOf(c, c.low), h("span", { class: "ramp", style: { background: `linear-gradient(90deg, ${RAMP.join(",")})` } }), textOf(c, c.high))];
  }
  return c.names.slice(0, 12).map((name, k) => h("span", { class: "key" }, h("span", { class: "patch", style: { background: `var(--series-${(k % SERIES) + 1})` } }), textOf(c, name)));
}

// Histogram of one column: all rows pale, the selected ones of them strong.
export function histogramPlot(column, { brushed, removed }) {
  let data = null, brush = null, at = -1;
  const caption = h("span", { class: "soft small number" });
  const view = surface((context, width, height) => draw(context, width, height), { class: "histogram-canvas", tabindex: "0", role: "img" });
  const { canvas } = view;
  const element = h("figure", { class: "histogram" },
    h("figcaption", {}, h("h3", { title: column.description }, titleOf(column)), caption,
      h("button", { type: "button", class: "quiet close", "aria-label": `Hide ${titleOf(column)}`, on: { click: () => removed() } }, "×")),
    canvas);

  const places = (width) => {
    const bins = data.every.length - 1, gap = data.every[bins] ? 14 : 0, unit = (width - gap) / (bins + (gap ? 1 : 0));
    return { bins, unit, left: (k) => k * unit + (k >= bins ? gap : 0) };
  };
  function draw(context, width, height) {
    if (!data) return;
    const { bins, unit, left } = places(width), foot = height - 18;
    // The undefined rows are often many; their bar ends at the top instead of flattening the others.
    const most = Math.max(...data.every.slice(0, bins)) || Math.max(1, data.every[bins]);
    const picked = binsOfBrush(data, brush);
    if (picked) {
      context.fillStyle = color(canvas, "--accent-soft");
      context.fillRect(left(picked[0]), 0, left(picked[1]) + unit - left(picked[0]), foot);
    }
    const inset = Math.min(1, unit / 8);
    const bars = (values, fill) => {
      context.fillStyle = fill;
      values.forEach((value, k) => {
        if (!value) return;
        const tall = Math.max(1.5, Math.min(1, value / most) * (foot - 6));
        context.fillRect(left(k) + inset, foot - tall, Math.max(1, unit - 2 * inset), tall);
      });
    };
    bars(data.every, color(canvas, "--line-strong"));
    if (!data.whole) bars(data.selected, color(canvas, "--accent"));
    context.strokeStyle = color(canvas, "--line");
    context.beginPath(); context.moveTo(0, foot + 0.5); context.lineTo(width, foot + 0.5); context.stroke();
    context.fillStyle = color(canvas, "--soft");
    context.font = "11px system-ui, sans-serif";
    context.textBaseline = "top";
    const end = left(bins - 1) + unit;
    if (column.numeric) {
      const ends = data.levels.length ? [data.levels[0], data.levels[bins - 1]] : [data.edges[0], data.edges[bins]];
      context.textAlign = "left"; context.fillText(textOf(column, ends[0]), 0, foot + 4);
      if (bins > 1) { context.textAlign = "right"; context.fillText(textOf(column, ends[1]), end, foot + 4); }
    } else {
      context.textAlign = "center";
      const room = Math.floor(unit / 6.2);
      data.levels.map((level) => textOf(column, level)).forEach((name, k) => { if (room > 2) context.fillText(name.length > room ? `${name.slice(0, room - 1)}…` : name, left(k) + unit / 2, foot + 4); });
    }
    if (data.every[bins]) { context.textAlign = "right"; context.fillText("∅", width - 1, foot + 4); }
    if (at >= 0) {
      context.strokeStyle = color(canvas, "--ink");
      context.strokeRect(left(at) + 0.5, 0.5, unit - 1, foot - 1);
    }
  }
  const name = (k) => {
    const bins = data.every.length - 1;
    if (k >= bins) return "undefined";
    return data.levels.length ? textOf(column, data.levels[k]) : `${textOf(column, data.edges[k])} to ${textOf(column, data.edges[k + 1])}`;
  };
  const tell = () => {
    caption.textContent = at >= 0 ? `${name(at)}: ${data.whole ? "" : `${count(data.selected[at])} of `}${count(data.every[at])}` : "";
    view.paint();
  };
  const binAt = (place) => {
    const { bins, unit, left } = places(canvas.clientWidth), last = data.every[bins] ? bins : bins - 1;
    for (let k = last; k > 0; k -= 1) if (place >= left(k)) return k;
    return Math.max(0, Math.min(last, Math.floor(place / unit)));
  };
  const pick = (a, b) => {
    const bins = data.every.length - 1;
    const [first, last] = a <= b ? [a, b] : [b, a];
    brushed(brushOfBins(data, column.numeric, first >= bins ? bins : first, last));
  };
  canvas.addEventListener("pointermove", (event) => { if (data && !event.buttons) { at = binAt(event.offsetX); tell(); } });
  canvas.addEventListener("pointerleave", () => { at = -1; if (data) tell(); });
  canvas.addEventListener("blur", () => { at = -1; if (data) tell(); });
  dragging(canvas, ([ax], [bx], ended) => {
    if (!data) return;
    const a = binAt(ax), b = binAt(bx), covered = binsOfBrush(data, brush);
    if (ended && a === b && Math.abs(ax - bx) < 4 && covered && covered[0] === a && covered[1] === a) brushed(null);
    else pick(a, b);
  });
  canvas.addEventListener("keydown", (event) => {
    if (!data) return;
    const last = data.every[data.every.length - 1] ? data.every.length - 1 : data.every.length - 2;
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (step) {
      event.preventDefault();
      const next = Math.max(0, Math.min(last, at + step)), covered = binsOfBrush(data, brush);
      if (event.shiftKey) pick(covered ? (step > 0 ? covered[0] : Math.min(covered[0], next)) : Math.max(at, 0), step > 0 ? next : covered ? covered[1] : next);
      at = next;
      tell();
    } else if (event.key === "Enter" && at >= 0) pick(at, at);
    else if (event.key === "Escape") brushed(null);
  });
  return {
    element, end: view.end,
    show(given, picked, whole) {
      data = { ...given, whole };
      brush = picked;
      canvas.setAttribute("aria-label", `Histogram of ${titleOf(column)}: drag over bars to select, or arrow keys and Enter; Escape clears`);
      tell();
    },
  };
}

// Parallel coordinates: rows counted from bin to bin of neighbouring axes; undefined values run through a band of their own.
export function parallelPlot({ brushed }) {
  let data = null;
  const side = 60, head = 30, band = 26, foot = 22;
  const view = surface((context, width, height) => draw(context, width, height), { class: "parallel-canvas", tabindex: "0", role: "img", "aria-label": "Parallel coordinates" });
  const { canvas } = view;
  let drag = null;

  const axisAt = (k, width) => side + (k * (width - 2 * side)) / Math.max(1, data.axes.length - 1);
  // How far up its axis a bin is. Single values of a number are as far apart as the values.
  const shareOf = ({ every, levels, column }, bin) => {
    const bins = every.length - 1, end = 0.5 / bins;
    return column.numeric && levels.length > 1 ? end + ((levels[bin] - levels[0]) / (levels[bins - 1] - levels[0])) * (1 - 2 * end) : (bin + 0.5) / bins;
  };
  const placeOf = (axis, bin, height) => {
    if (bin >= axis.every.length - 1) return height - foot - band / 2;
    return height - foot - band - 8 - shareOf(axis, bin) * (height - foot - band - 8 - head);
  };
  function flow(context, width, height, links, stroke, strength) {
    context.strokeStyle = stroke;
    links.forEach((link, k) => {
      const most = link.pairs.reduce((a, pair) => Math.max(a, pair[2]), 1);
      const x0 = axisAt(k, width), x1 = axisAt(k + 1, width), bend = (x1 - x0) / 2.4;
      for (const [a, b, n] of link.pairs) {
        const share = Math.sqrt(n / most);
        context.globalAlpha = strength * (0.06 + 0.6 * share);
        context.lineWidth = share > 0.4 ? 0.8 + 2.6 * share : 1; // a curve of one pixel is drawn four times as fast
        const y0 = placeOf(data.axes[k], a, height), y1 = placeOf(data.axes[k + 1], b, height);
        context.beginPath(); context.moveTo(x0, y0); context.bezierCurveTo(x0 + bend, y0, x1 - bend, y1, x1, y1); context.stroke();
      }
    });
    context.globalAlpha = 1;
  }
  let behind = null; // the flow of all rows, drawn once: thousands of curves
  function flowBehind(width, height) {
    const key = [width, height, canvas.width, color(canvas, "--line-strong")].join();
    if (behind?.key !== key || behind.of !== data.every) {
      behind = { key, of: data.every, picture: new OffscreenCanvas(canvas.width, canvas.height) };
      const context = behind.picture.getContext("2d");
      context.scale(canvas.width / width, canvas.height / height);
      flow(context, width, height, data.every, color(canvas, "--line-strong"), 0.5);
    }
    return behind.picture;
  }
  function draw(context, width, height) {
    if (!data || data.axes.length < 2) return;
    context.fillStyle = color(canvas, "--sunk");
    context.fillRect(0, height - foot - band, width, band);
    context.textBaseline = "middle";
    context.lineJoin = "round";
    // A label over lines has a halo, so that none strikes it through.
    const label = (text, x, y) => {
      context.strokeStyle = color(canvas, "--card");
      context.lineWidth = 6;
      context.strokeText(text, x, y);
      context.fillText(text, x, y);
    };
    if (data.every && !data.whole) context.drawImage(flowBehind(width, height), 0, 0, width, height);
    if (data.links) flow(context, width, height, data.links, color(canvas, "--accent"), 1);
    context.fillStyle = color(canvas, "--soft");
    context.textAlign = "left";
    context.font = "11px system-ui, sans-serif";
    label("undefined", 4, height - foot - band + 8);
    data.axes.forEach((axis, k) => {
      const x = axisAt(k, width), bins = axis.every.length - 1;
      const top = placeOf(axis, bins - 1, height), low = placeOf(axis, 0, height);
      const picked = binsOfBrush(axis, drag?.axis === k ? drag.brush : axis.brush);
      if (picked) {
        const half = bins > 1 && !axis.levels.length ? (low - top) / (bins - 1) / 2 : 8;
        context.fillStyle = color(canvas, "--accent");
        context.globalAlpha = 0.25;
        const from = placeOf(axis, picked[1], height) - (picked[1] >= bins ? band / 2 : half);
        context.fillRect(x - 7, from, 14, placeOf(axis, picked[0], height) + (picked[0] >= bins ? band / 2 : half) - from);
        context.globalAlpha = 1;
      }
      context.lineWidth = 1;
      context.strokeStyle = color(canvas, "--soft");
      context.beginPath(); context.moveTo(x + 0.5, head - 4); context.lineTo(x + 0.5, height - foot); context.stroke();
      context.textAlign = k === 0 ? "left" : k === data.axes.length - 1 ? "right" : "center";
      const edge = k === 0 ? -side + 4 : k === data.axes.length - 1 ? side - 4 : 0;
      context.fillStyle = color(canvas, "--ink");
      context.font = "600 12px system-ui, sans-serif";
      context.fillText(clip(context, titleOf(axis.column), (width - 2 * side) / Math.max(1, data.axes.length - 1) - 8), x + edge, 9);
      context.fillStyle = color(canvas, "--soft");
      context.font = "11px system-ui, sans-serif";
      const names = !axis.column.numeric && bins <= 8;
      const marks = names ? axis.levels.map((name, bin) => [bin, name]) : [[0, axis.levels.length ? axis.levels[0] : axis.edges[0]], [bins - 1, axis.levels.length ? axis.levels[bins - 1] : axis.edges[bins]]];
      context.textAlign = k === data.axes.length - 1 ? "right" : "left";
      for (const [bin, value] of marks) label(textOf(axis.column, value), x + (k === data.axes.length - 1 ? -8 : 8), placeOf(axis, bin, height) - 8);
    });
  }
  const clip = (context, text, room) => { let short = text; while (short.length > 4 && context.measureText(short).width > room) short = `${short.slice(0, -2)}…`; return short; };
  const nearestAxis = (x) => { let best = 0; data.axes.forEach((_, k) => { if (Math.abs(axisAt(k, canvas.clientWidth) - x) < Math.abs(axisAt(best, canvas.clientWidth) - x)) best = k; }); return best; };
  const binAt = (axis, y) => {
    const bins = axis.every.length - 1, height = canvas.clientHeight;
    if (y > height - foot - band && axis.every[bins]) return bins;
    const share = (height - foot - band - 8 - y) / (height - foot - band - 8 - head);
    if (!axis.levels.length) return Math.max(0, Math.min(bins - 1, Math.floor(share * bins)));
    const away = axis.levels.map((_, bin) => Math.abs(shareOf(axis, bin) - share));
    return away.indexOf(Math.min(...away));
  };
  dragging(canvas, ([ax, ay], [, by], ended) => {
    if (!data) return;
    const k = nearestAxis(ax), axis = data.axes[k], a = binAt(axis, ay), b = binAt(axis, by), bins = axis.every.length - 1;
    if (Math.abs(ay - by) < 4 && ended && axis.brush) { drag = null; brushed(axis.column.name, null); return; }
    const [first, last] = a <= b ? [a, b] : [b, a];
    const brush = brushOfBins(axis, axis.column.numeric, first, a === bins && b === bins ? bins : last);
    drag = ended ? null : { axis: k, brush };
    if (ended) brushed(axis.column.name, brush);
    else view.paint();
  });
  return {
    element: h("div", { class: "plot" }, canvas), end: view.end,
    show(given) {
      data = { ...data, ...given };
      canvas.setAttribute("aria-label", `Parallel coordinates of ${data.axes.map((axis) => titleOf(axis.column)).join(", ")}: drag along an axis to select. The histograms select the same from the keyboard.`);
      view.paint();
    },
  };
}
