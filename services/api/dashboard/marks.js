// Tags and a note on a run, a frame or a finding: shown, and edited in a dialog.
import { get, replace } from "./api.js";
import { h, put, toast } from "./dom.js";
import { may } from "./role.js";

const NOTHING = { tags: [], note: "" };

export const tagList = (tags) => tags.map((tag) => h("a", { class: "tag", href: `#/?tag=${encodeURIComponent(tag)}`, title: "Runs with this tag" }, tag));

// The marks of a run, read once and shared by all places that show one.
export function marksOf(run, signal) {
  let marks = null;
  const shown = new Set();
  const path = `/v1/runs/${run}/marks`;
  const load = async () => { marks = await get(path, { signal }); shown.forEach((draw) => draw()); };
  return {
    load,
    // A place that shows and edits one mark. `what` says what it is on.
    place(kind, name, what) {
      const slot = h("div", { class: "mark" });
      const of = () => marks?.find((one) => one.kind === kind && one.name === name) ?? NOTHING;
      const edit = async () => {
        const changed = await ask(of(), what, signal);
        if (!changed) return;
        try {
          marks = await replace(path, { kind, name, ...changed });
          shown.forEach((draw) => draw());
        } catch (error) {
          toast(error.message);
        }
      };
      const draw = () => {
        const { tags, note } = of();
        const focused = slot.contains(document.activeElement);
        put(slot, [tags, note, marks === null], tagList(tags), note ? h("span", { class: "mark-note" }, note) : null,
          marks === null || !may("PUT /v1/runs/{run_id}/marks") ? null : h("button", { type: "button", class: "quiet small", "aria-label": `Tags and note of ${what}`, on: { click: edit } }, tags.length || note ? "Edit" : "Add tag or note"));
        if (focused) slot.querySelector("button")?.focus();
      };
      shown.add(draw);
      draw();
      return slot;
    },
  };
}

function ask({ tags, note }, what, signal) {
  return new Promise((resolve) => {
    let answer = null;
    const words = h("input", { type: "text", id: "mark-tags", value: tags.join(", "), autocomplete: "off", maxlength: 800 });
    const text = h("textarea", { id: "mark-note", rows: 4, maxlength: 10_000 });
    text.value = note;
    const save = () => {
      answer = { tags: [...new Set(words.value.split(",").map((one) => one.trim()).filter(Boolean))], note: text.value.trim() };
      dialog.close();
    };
    const dialog = h("dialog", { "aria-labelledby": "dialog-title", on: { close: () => { dialog.remove(); resolve(answer); } } },
      h("div", { class: "stack" }, h("h2", { id: "dialog-title" }, `Tags and note of ${what}`),
        h("label", { for: "mark-tags" }, "Tags, with commas between them"), words,
        h("label", { for: "mark-note" }, "Note"), text,
        h("div", { class: "row" },
          h("button", { type: "button", on: { click: () => dialog.close() } }, "Back"),
          h("button", { type: "button", class: "primary", on: { click: save } }, "Save"))));
    words.addEventListener("keydown", (event) => { if (event.key === "Enter") { event.preventDefault(); save(); } }); // else it would press the button that gets the focus back
    signal.addEventListener("abort", () => dialog.close(), { once: true }); // another page is shown
    document.body.append(dialog);
    dialog.showModal();
  });
}
