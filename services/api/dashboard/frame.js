// One frame: picture, ground truth and predictions, with the scores of each function.
import { get, picture } from "./api.js";
import { h, put, s, table } from "./dom.js";
import { fixed, heading, percent, short, shown, value, withUnit, words } from "./format.js";
import { marksOf } from "./marks.js";
import { player } from "./player.js";
import { isRemote, reaching } from "./role.js";
import { errorLegend, sheet } from "./thumbnails.js";

const VIEWS = { all: "All", picture: "Picture", truth: "Truth", prediction: "Prediction", errors: "Errors", instances: "Instances", depth: "Depth", normals: "Normals", boxes: "3D boxes", joints: "Joints", flow: "Flow", velocity: "Velocity" };
const OF_FUNCTION = new Set(["prediction", "errors"]);
const OPTIONAL = new Set(["normals", "boxes", "joints", "flow", "velocity"]); // only in runs that asked for them
const WHOLE = new Set(["instances", "depth", ...OPTIONAL]); // opaque pictures of their own
const NOTES = {
  depth: "Bright is near, from 1 m to 200 m. Black is empty.",
  normals: "Direction that the surface faces in the world: red to the right, green ahead, blue up. Black is no surface.",
  flow: "Displacement to the next frame: white stands still, red moves right, green down, cyan left, violet up. Stronger colours move farther, relative to the largest displacement in this frame. Grey is undefined.",
  velocity: "Velocity in the image: white stands still, red moves right, green down, cyan left, violet up. Stronger colours move faster, relative to the fastest point in this frame.",
};
const SETTINGS = { view: "prediction", opacity: 60, boxes: true, near: false, zoom: null }; // kept from frame to frame
const CLOSEST = 64;

let labels = null;
let measures = null; // the columns of results, with their titles and units

export async function frameView({ main, key, parameters, signal }) {
  if (VIEWS[parameters.get("view")]) SETTINGS.view = parameters.get("view");
  if (parameters.has("opacity")) SETTINGS.opacity = Math.max(0, Math.min(100, Number(parameters.get("opacity")) || 0));
  if (parameters.has("near")) SETTINGS.near = parameters.get("near") === "1";
  const frame = await get(`/v1/frames/${key}`, { signal });
  const run = await get(`/v1/runs/${frame.run_id}`, { signal });
  labels ??= await get("/v1/labels", { signal });
  measures ??= await get("/v1/measures", { signal });

  const marks = marksOf(frame.run_id, signal);
  const offered = Object.keys(VIEWS).filter((name) => !OPTIONAL.has(name) || frame.images[name]);
  // The panes of a view: one, or one for each evaluation by a function.
  const layers = (view) => (view === "all" ? offered.slice(1).flatMap(layers)
    : OF_FUNCTION.has(view) && frame.evaluations.length ? frame.evaluations.map((evaluation) => ({ view, evaluation })) : [{ view, evaluation: null }]);
  const panes = h("div", { class: "panes" });
  const legend = h("div", {});
  const slider = h("input", { type: "range", min: 0, max: 100, value: SETTINGS.opacity, id: "opacity", on: { input: () => { SETTINGS.opacity = Number(slider.value); update(); } } });
  const slide = h("label", { class: "inline", for: "opacity" }, "Overlay", slider);
  const views = h("div", { class: "segments", role: "group", "aria-label": "What is shown" }, offered.map((name) =>
    h("button", { type: "button", "data-view": name, on: { click: () => { SETTINGS.view = name; update(); } } }, VIEWS[name])));
  const boxes = toggle("Boxes", "boxes", () => update());
  const magnify = (factor) => moved(zoomed(currentZoom(frame), factor, 0.5, 0.5));
  const show = (near) => { SETTINGS.near = near; SETTINGS.zoom = null; update(); };
  const zoomTo = [["Whole", false], ["Person", true]].map(([text, near]) => h("button", { type: "button", on: { click: () => show(near) } }, text));
  const zoom = h("div", { class: "segments", role: "group", "aria-label": "Zoom" },
    h("button", { type: "button", "aria-label": "Zoom out", on: { click: () => magnify(1 / 1.5) } }, "−"), h("button", { type: "button", "aria-label": "Zoom in", on: { click: () => magnify(1.5) } }, "+"), zoomTo);
  const reading = h("p", { class: "small soft number reading" });
  const title = `Variant ${frame.variant_index}, ${frame.camera}${frame.sequence || frame.time_s ? `, ${fixed(frame.time_s, 2)} s` : ""}`;
  let moment = key; // the frame of the sequence whose pictures are shown
  const sequence = player(frame, {
    show: (id) => { moment = id; return Promise.all(visible().map((one) => one.show(id))); },
    open: (id) => { location.hash = `#/frames/${id}`; },
    signal,
  });
  const step = (text, target, label) => (target
    ? h("a", { class: "button", href: `#/frames/${target}`, "aria-label": label }, text)
    : h("button", { type: "button", disabled: true, "aria-label": label }, text));
  main.replaceChildren(...[
    h("div", { class: "stack" },
      h("p", { class: "crumbs" }, h("a", { href: "#/" }, "Runs"), " / ", h("a", { href: `#/runs/${frame.run_id}` }, run.name), " / ", h("span", { class: "mono" }, `${frame.variant_index}.${frame.id.split(".").slice(2).join(".")}`)),
      h("div", { class: "spread" },
        h("h1", {}, title),
        h("div", { class: "row" }, step("← Previous", frame.previous, "Previous frame"), step("Next →", frame.next, "Next frame"))),
      marks.place("frame", frame.id.slice(frame.run_id.length + 1), "this frame")),
    frame.removed ? remaining(frame)
      : frame.state === "done" ? null : h("p", { class: `note ${frame.state === "failed" ? "bad" : "wait"}` }, `The products of this frame are ${words(frame.state)}. Pictures appear when they are made.`),
    frame.removed ? null : h("section", { class: "card viewer", "aria-label": "Pictures" }, h("div", { class: "head" }, views, slide, boxes, zoom), panes, reading, sequence, legend),
    h("div", { class: "columns" }, personsSection(frame), scoresSection(frame)),
    variantSection(frame),
  ].filter(Boolean));

  const shownPanes = new Map();
  const visible = () => [...shownPanes.values()].filter((one) => one.element.isConnected);
  const pressed = () => zoomTo.forEach((button, near) => button.setAttribute("aria-pressed", String(!SETTINGS.zoom && SETTINGS.near === Boolean(near))));
  // All panes share one zoom.
  const moved = (zoom) => {
    SETTINGS.zoom = zoom;
    pressed();
    visible().forEach((one) => one.place());
  };
  // What the pointer is on. The server reads one pixel at a time; the newest place comes next.
  let place = null, asked = false;
  const say = (known) => { reading.textContent = place ? [`x ${place[0]}, y ${place[1]}`, ...new Set(visible().map((one) => one.color(place)).filter(Boolean)), ...known].join(" · ") : RESTING; };
  const pointed = async (at) => {
    if (at?.join() === place?.join()) return;
    place = at;
    visible().forEach((one) => one.point(at));
    say([]);
    if (asked) return;
    asked = true;
    try {
      for (let read = null; place && read !== place;) {
        read = place;
        const seen = await get(`/v1/frames/${moment}/pixel?x=${read[0]}&y=${read[1]}`, { signal });
        if (read === place) say(seen.flatMap((one) => pixelWords(one, seen.length > 1)));
      }
    } catch { /* the truth is not there yet, or another page is shown */ } finally { asked = false; }
  };
  say([]);
  const update = () => {
    if (frame.removed) return;
    if (!offered.includes(SETTINGS.view)) SETTINGS.view = "picture"; // the view of a frame of another run
    const { view } = SETTINGS;
    const parts = new URLSearchParams({ view, opacity: SETTINGS.opacity, ...(SETTINGS.near ? { near: "1" } : {}) });
    history.replaceState(history.state, "", `#/frames/${key}?${parts}`);
    for (const button of views.children) button.setAttribute("aria-pressed", String(button.dataset.view === view));
    pressed();
    slide.hidden = view === "picture" || view === "all" || WHOLE.has(view);
    const wanted = layers(view).map((one) => ({ ...one, key: [one.view, one.evaluation?.function, one.evaluation?.sensor, !one.evaluation && view === "all"].join(" ") }));
    put(panes, wanted.map((one) => one.key), wanted.map((one) => {
      if (!shownPanes.has(one.key)) shownPanes.set(one.key, pane(frame, one, view === "all", { moved, pointed }));
      return shownPanes.get(one.key).element;
    }));
    panes.classList.toggle("two", wanted.length > 1);
    wanted.forEach((one) => shownPanes.get(one.key).show());
    put(legend, view, legendOf(view));
  };
  update();

  addEventListener("keydown", (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey || /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
    if (event.key === "ArrowLeft" && frame.previous) location.hash = `#/frames/${frame.previous}`;
    else if (event.key === "ArrowRight" && frame.next) location.hash = `#/frames/${frame.next}`;
    else if (event.key === "+" || event.key === "-") magnify(event.key === "+" ? 1.5 : 1 / 1.5);
    else if (event.key === "0") show(false);
    else if (event.key === "z") show(!SETTINGS.near);
  }, { signal });
  if (!frame.removed) prefetch(frame, signal);
  marks.load().catch(() => {});
  return title;
}

function toggle(text, name, changed) {
  const box = h("input", { type: "checkbox", checked: SETTINGS[name], on: { change: () => { SETTINGS[name] = box.checked; changed(); } } });
  return h("label", { class: "inline" }, box, text);
}

// What remains of a frame whose pictures are gone.
function remaining(frame) {
  const shown = frame.evaluations.length ? frame.evaluations : [null], kinds = frame.evaluations.length ? ["picture", "errors"] : ["picture"];
  const cells = kinds.map((kind) => shown.map((one) => ({ kind, row: { frame_id: frame.id, function: one?.function ?? "", sensor: one?.sensor ?? "" }, image: h("span", { class: "thumbnail waiting", role: "img", "aria-label": `Thumbnail: ${VIEWS[kind]}${one ? ` of ${one.function}` : ""}` }) })));
  for (const some of cells) sheet(some, some[0].kind, false);
  return h("section", { class: "stack", "aria-label": "Thumbnails" },
    h("p", { class: "note" }, `The picture was removed (${frame.removed}); the thumbnail remains. So do the numbers; a run of the same spec with retention: all makes the pictures again.`),
    h("div", { class: "thumbnails" }, cells.flat().map(({ kind, row, image }) => h("div", {}, image, h("span", { class: "small soft" }, [VIEWS[kind], row.function].filter(Boolean).join(" · "))))),
    frame.evaluations.length ? errorLegend() : null);
}

// Load the neighbours' pictures after this frame's own.
function prefetch(frame, signal) {
  setTimeout(() => {
    if (signal.aborted) return;
    for (const target of [frame.next, frame.previous]) {
      if (target) for (const path of Object.values(frame.images).slice(0, 2)) picture(path.replace(frame.id, target)).catch(() => {});
    }
  }, 700);
}

const RESTING = "Wheel, two fingers or + and − zoom, dragging moves; every picture follows. A pixel under the pointer is read here.";
// A pixel as a sensor sees it: class, instance, depth, and the class of each function.
const pixelWords = (one, several) => [`${several ? `${one.sensor}: ` : ""}truth ${one.label}${one.instance_id ? ` ${one.instance_id}` : ""}`, one.depth_m === null ? "no depth" : `${fixed(one.depth_m, 2)} m`,
  ...Object.entries(one.predictions).map(([name, label]) => `${name} ${label}`)];

// What of the frame is shown: the scale, and the left and top end as shares of the picture.
const currentZoom = (frame) => SETTINGS.zoom ?? (SETTINGS.near ? zoomOf(frame) : null) ?? { scale: 1, x: 0, y: 0 };
const within = (scale, x, y) => { const most = 1 - 1 / scale; return { scale, x: Math.max(0, Math.min(most, x)), y: Math.max(0, Math.min(most, y)) }; };
// Zoom around a place of the window, as shares of its size.
function zoomed({ scale, x, y }, factor, px, py) {
  const next = Math.max(1, Math.min(CLOSEST, scale * factor));
  return within(next, x + px / scale - px / next, y + py / scale - py / next);
}

// Values of a picture's pixels, read once it is drawn.
const pixels = new WeakMap();
function pixelOf(image, [x, y]) {
  if (!image.complete || !image.naturalWidth || image.hidden) return null;
  let kept = pixels.get(image);
  if (kept?.src !== image.src) {
    const canvas = h("canvas", { width: image.naturalWidth, height: image.naturalHeight });
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    kept = { src: image.src, context };
    pixels.set(image, kept);
  }
  return [...kept.context.getImageData(x, y, 1, 1).data].slice(0, 3);
}

function pane(frame, { view, evaluation }, titled, { moved, pointed }) {
  const below = h("img", { alt: "" });
  const above = h("img", { alt: "", class: "above" });
  const trouble = h("p", { class: "trouble", hidden: true });
  const rectangles = s("svg", { viewBox: `0 0 ${frame.width} ${frame.height}`, preserveAspectRatio: "none", "aria-hidden": "true" });
  const cross = h("span", { class: "cross", hidden: true, "aria-hidden": "true" });
  const world = h("div", { class: "world" }, below, above, rectangles);
  const window_ = h("div", { class: "window", style: { "aspect-ratio": `${frame.width} / ${frame.height}` } }, world, cross, trouble);
  const title = [titled || evaluation ? VIEWS[view] : null, evaluation?.function].filter(Boolean).join(" · ");
  const caption = title ? h("figcaption", {}, h("h3", {}, title), evaluation ? h("span", { class: "soft small number" }, captionOf(frame, evaluation)) : null) : null;
  const element = h("figure", {}, caption, window_);
  let latest = 0;

  const load = async (image, path, mine) => {
    if (image.dataset.path === path) return;
    window_.classList.add("waiting");
    try {
      const url = await picture(path);
      if (mine !== latest) return;
      image.src = url;
      image.dataset.path = path;
      await image.decode().catch(() => {});
      if (mine === latest) window_.classList.remove("waiting");
    } catch (error) {
      if (mine !== latest) return;
      window_.classList.remove("waiting");
      trouble.textContent = error.message;
      trouble.hidden = false;
    }
  };

  // For another frame of the sequence show the pictures alone, since boxes are known for this frame only.
  const show = (id = frame.id) => {
    const { opacity, boxes } = SETTINGS;
    const mine = (latest += 1);
    trouble.hidden = true;
    const images = evaluation ? evaluation.images : frame.images;
    const loads = [load(below, images.picture.replace(frame.id, id), mine)];
    const over = view === "picture" ? null : images[view];
    above.hidden = !over;
    if (over) loads.push(load(above, over.replace(frame.id, id), mine));
    above.style.setProperty("opacity", WHOLE.has(view) ? "1" : String(opacity / 100));
    element.setAttribute("aria-label", `${VIEWS[view]}${evaluation ? ` of ${evaluation.function}` : ""}`);
    rectangles.replaceChildren(...(boxes && id === frame.id ? frame.persons.filter((one) => one.amodal_box).flatMap((one) => outline(one)) : []));
    place();
    return Promise.all(loads);
  };

  const place = () => {
    const { scale, x, y } = currentZoom(frame);
    world.classList.toggle("near", scale > 1);
    world.classList.toggle("free", Boolean(SETTINGS.zoom));
    world.style.setProperty("--scale", scale);
    world.style.setProperty("transform", scale > 1 ? `scale(${scale}) translate(${-100 * x}%, ${-100 * y}%)` : "none");
  };
  const share = (event) => { const box = window_.getBoundingClientRect(); return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height]; };
  window_.addEventListener("wheel", (event) => {
    event.preventDefault();
    moved(zoomed(currentZoom(frame), Math.exp(-event.deltaY / 400), ...share(event)));
  }, { passive: false });
  window_.addEventListener("dblclick", (event) => moved(zoomed(currentZoom(frame), 2, ...share(event))));
  // One pointer drags; two zoom by their distance, around their middle.
  const pointers = new Map();
  window_.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || (currentZoom(frame).scale === 1 && event.pointerType === "mouse")) return;
    pointers.set(event.pointerId, share(event));
    if (event.pointerType === "mouse") event.preventDefault();
    if (pointers.size > 1 || currentZoom(frame).scale > 1) window_.setPointerCapture(event.pointerId);
  });
  window_.addEventListener("pointermove", (event) => {
    if (!pointers.has(event.pointerId)) return;
    const before = [...pointers.values()];
    pointers.set(event.pointerId, share(event));
    const after = [...pointers.values()];
    const middle = (all) => [0, 1].map((k) => all.reduce((sum, one) => sum + one[k], 0) / all.length);
    const apart = (all) => (all.length > 1 ? Math.hypot(all[0][0] - all[1][0], all[0][1] - all[1][1]) || 1e-3 : 1);
    const start = currentZoom(frame), from = middle(before), to = middle(after);
    if (start.scale === 1 && pointers.size < 2) return;
    moved(zoomed(within(start.scale, start.x - (to[0] - from[0]) / start.scale, start.y - (to[1] - from[1]) / start.scale), apart(after) / apart(before), ...to));
  });
  for (const kind of ["pointerup", "pointercancel"]) window_.addEventListener(kind, (event) => pointers.delete(event.pointerId));
  window_.addEventListener("pointermove", (event) => {
    const { scale, x, y } = currentZoom(frame), [px, py] = share(event);
    const at = [Math.floor((x + px / scale) * frame.width), Math.floor((y + py / scale) * frame.height)];
    pointed(at[0] >= 0 && at[1] >= 0 && at[0] < frame.width && at[1] < frame.height ? at : null);
  });
  window_.addEventListener("pointerleave", () => pointed(null));

  // The cross-hair, at the same pixel in every pane.
  const point = (at) => {
    cross.hidden = !at;
    if (!at) return;
    const { scale, x, y } = currentZoom(frame), left = ((at[0] + 0.5) / frame.width - x) * scale, top = ((at[1] + 0.5) / frame.height - y) * scale;
    cross.style.setProperty("left", `${100 * left}%`);
    cross.style.setProperty("top", `${100 * top}%`);
  };
  const color = (at) => { const rgb = pixelOf(below, at); return rgb && `RGB ${rgb.join(" ")}`; };
  return { element, show, place, point, color };
}

function captionOf(frame, evaluation) {
  if (evaluation.state !== "done") return words(evaluation.state);
  const parts = evaluation.persons.map((one) => `${evaluation.persons.length > 1 ? `${nameOf(frame.persons.find((person) => person.instance_id === one.instance_id) ?? one)} ` : ""}pACC ${percent(one.pacc)}`);
  return [...parts, `IoU ${percent(evaluation.iou)}`].join(" · ");
}

const nameOf = (person) => person.character ?? `person-${person.instance_id % 1000}`;

function outline(person) {
  const box = ([x0, y0, x1, y1], kind) => s("rect", { x: x0, y: y0, width: x1 - x0, height: y1 - y0, class: kind, "vector-effect": "non-scaling-stroke" });
  return [box(person.amodal_box, "amodal"), person.box ? box(person.box, "visible") : null].filter(Boolean);
}

// A window around all persons with a margin, in the proportions of the picture.
function zoomOf(frame) {
  const boxes = frame.persons.map((person) => person.amodal_box).filter(Boolean);
  if (!boxes.length) return null;
  const x0 = Math.min(...boxes.map((b) => b[0])), y0 = Math.min(...boxes.map((b) => b[1]));
  const x1 = Math.max(...boxes.map((b) => b[2])), y1 = Math.max(...boxes.map((b) => b[3]));
  const share = Math.min(1, Math.max((2 * (x1 - x0)) / frame.width, (1.7 * (y1 - y0)) / frame.height, 0.06));
  const place = (middle, size) => Math.max(0, Math.min(1 - share, middle / size - share / 2));
  return { scale: 1 / share, x: place((x0 + x1) / 2, frame.width), y: place((y0 + y1) / 2, frame.height) };
}

function legendOf(view) {
  if (NOTES[view]) return h("p", { class: "small soft under" }, NOTES[view]);
  if (view === "errors") return errorLegend();
  if (view === "all") return h("div", { class: "stack" }, errorLegend(), classLegend());
  return view === "truth" || view === "prediction" ? classLegend() : null;
}

function classLegend() {
  return h("div", { class: "legend under classes" }, labels.filter((one) => one.train_id < 255).map((one) =>
    h("span", { class: "key" }, h("span", { class: "patch", style: { background: `rgb(${one.color.join(" ")})` } }), one.name)));
}

// The persons in the scene; an asset may declare more.
const peopleOf = (frame) => frame.persons.filter((one) => one.instance_id && one.undefined_reason !== "absent");

const measuresFrom = (...sources) => measures.filter((measure) => sources.includes(measure.source));
// One line of a table of measures: its title, then a value in each column.
const line = (measure, values) => h("tr", {}, h("th", { scope: "row", title: measure.description }, heading(measure.title)),
  values.map((value) => h("td", { class: "right" }, shown(measure, value))));

function personsSection(frame) {
  const people = peopleOf(frame);
  const sources = ["place", "pixels", ...(frame.annotations.light ? ["light"] : [])];
  const body = people.length
    ? table(["", ...people.map((one) => ({ text: nameOf(one), class: "right" }))],
      measuresFrom(...sources).filter((measure) => measure.name !== "undefined_reason" || people.some((one) => one.undefined_reason))
        .map((measure) => line(measure, people.map((one) => one[measure.name]))), { caption: "Visibility of the persons" })
    : h("p", { class: "soft" }, "The scene holds no person here, so every pixel called person is a false positive.");
  return h("section", { class: "card" }, h("h2", {}, "Persons"), body);
}

// The classes of most of the missed pixels.
const calledInstead = ({ called_instead: classes, fn }) => Object.entries(classes).slice(0, 3).map(([name, n]) => h("div", {}, `${name} ${percent(n / fn, 0)}`));

function scoresSection(frame) {
  const done = frame.evaluations.filter((one) => one.state === "done");
  if (!done.length) return h("section", { class: "card" }, h("h2", {}, "Scores"), h("p", { class: "soft" }, frame.evaluations.length ? "Not evaluated yet." : "This run has no function under test."));
  const several = new Set(done.map((one) => one.sensor)).size > 1;
  const pacc = measures.find((measure) => measure.name === "pacc");
  const ofPerson = peopleOf(frame).map((person) => line({ ...pacc, title: `${pacc.title}, ${nameOf(person)}` },
    done.map((one) => one.persons.find((score) => score.instance_id === person.instance_id)?.pacc)));
  const counts = measures.filter((measure) => ["tp", "fn"].includes(measure.name));
  const ofFrame = [...counts, ...measuresFrom("frame score")].map((measure) => line(measure, done.map((one) => one[measure.name])));
  const instead = done.some((one) => one.fn) ? [h("tr", {}, h("th", { scope: "row", title: "what the pixels of persons are called that are not called person" }, "Missed, called instead"), done.map((one) => h("td", { class: "right" }, calledInstead(one))))] : [];
  return h("section", { class: "card" }, h("h2", {}, "Scores"),
    table(["", ...done.map((one) => ({ text: several ? `${one.function} · ${one.sensor}` : one.function, class: "right" }))], [...ofPerson, ...instead, ...ofFrame], { caption: "Scores per function" }),
    [...new Set(done.filter((one) => one.judged_by.length).map((one) => `${one.function}: mIoU, fwIoU, mAcc and pixel accuracy are over ${one.judged_by.join(", ")} only.`))]
      .map((text) => h("p", { class: "small soft under" }, text)));
}

// The varied values; a neighbour differs in this one only.
function variantSection(frame) {
  const neighbours = new Map(frame.neighbours.map((one) => [one.parameter, one]));
  const entries = [...Object.entries(frame.assignment), ...(neighbours.has("camera") ? [["camera", frame.camera]] : [])];
  const text = (path, one) => withUnit(value(one), frame.units[path]);
  const link = (path, near, arrow) => near && h("a", { href: `#/frames/${near.frame}`, "aria-label": `${short(path)} ${text(path, near.value)}, else equal` }, arrow(text(path, near.value)));
  const item = ([path, one]) => {
    const { before, after } = neighbours.get(path) ?? {};
    return h("div", {}, h("dt", {}, short(path)), h("dd", { class: "number row" }, link(path, before, (near) => `← ${near}`), h("strong", {}, text(path, one)), link(path, after, (near) => `${near} →`)));
  };
  return h("section", { class: "card", "aria-label": "Variant" }, h("h2", {}, "Variant"),
    entries.length ? h("dl", { class: "facts" }, entries.map(item)) : h("p", { class: "soft" }, "Nothing is varied."),
    h("p", { class: "small soft under" }, neighbours.size ? "Arrows lead to the frame that differs in this value only. " : "", `Make this frame again and compare${isRemote() ? ", on the server’s machine" : ""}: `, h("code", {}, reaching(`valerie replay ${frame.id}`))));
}
