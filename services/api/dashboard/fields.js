// What the parts of a form share: labelled controls with their problems, and what somebody typed.
import { h } from "./dom.js";

// A number where it is one, else text such as "5 m"; null where nothing is written.
export const read = (text) => (text.trim() === "" ? null : Number.isFinite(Number(text)) ? Number(text) : text.trim());
export const fieldChange = (field, value) => ({ kind: "field", field, value });
// Problems of a place and of what is inside it.
export const problemsAt = (problems, place) => [...problems].filter(([field]) => field === place || field.startsWith(`${place}.`)).map(([, text]) => text);

// A control with its label and its problems. The control has the id `f-NAME`.
export function labelled(name, label, control, wrong, more = "") {
  if (wrong.length) {
    control.setAttribute("aria-invalid", "true");
    control.setAttribute("aria-describedby", `f-${name}-problem`);
  }
  return h("div", { class: `field ${more}${wrong.length ? " wrong" : ""}` }, h("label", { for: `f-${name}` }, label), control, wrong.length ? h("p", { class: "problem small", id: `f-${name}-problem` }, wrong.join("; ")) : null);
}

// The entries of a list of mappings such as `sensors`, which a form edits one by one; null where it cannot.
export function entriesIn(value) {
  if (value === undefined || value === null) return [];
  return Array.isArray(value) && value.every((one) => one && typeof one === "object" && !Array.isArray(one)) ? value.map((one) => ({ ...one })) : null;
}

// How a form edits the entries of the list `field`: each edit sends the whole list, which is kept here too, since the next edit
// may come before the answer to this one.
export function listOf(field, entries, change) {
  const send = () => change([fieldChange(field, entries.length ? entries.map((one) => ({ ...one })) : null)]);
  return {
    add: (entry) => { entries.push(entry); send(); },
    remove: (index) => { entries.splice(index, 1); send(); },
    // A null leaves a key out.
    set: (index, values) => {
      for (const [key, value] of Object.entries(values)) if (value === null) delete entries[index][key]; else entries[index][key] = value;
      send();
    },
  };
}

// The first of NAME-1, NAME-2 … that no entry has under `key`.
export function unused(name, entries, key) {
  const taken = new Set(entries.map((one) => one[key]));
  let number = entries.length + 1;
  while (taken.has(`${name}-${number}`)) number += 1;
  return `${name}-${number}`;
}

export const asText = (what) => h("p", { class: "note" }, `${what} of this document are edited as text.`);
