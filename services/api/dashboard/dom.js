// Elements of the page. Text stays text, whatever a name contains.

const SVG = "http://www.w3.org/2000/svg";

function fill(element, properties, children) {
  for (const [name, value] of Object.entries(properties ?? {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name === "on") for (const [event, handler] of Object.entries(value)) element.addEventListener(event, handler);
    else if (name === "style") for (const [key, rule] of Object.entries(value)) element.style.setProperty(key, rule);
    else if (name === "class") element.setAttribute("class", value);
    else if (name === "value" || name === "checked" || name === "disabled") element[name] = value;
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export const h = (tag, properties, ...children) => fill(document.createElement(tag), properties, children);
export const s = (tag, properties, ...children) => fill(document.createElementNS(SVG, tag), properties, children);

// Replace the content of an element unless `key` is unchanged, so that a poll disturbs neither selection nor focus.
const shown = new WeakMap();
export function put(element, key, ...children) {
  const text = JSON.stringify(key);
  if (shown.get(element) === text) return;
  shown.set(element, text);
  element.replaceChildren(...children.flat(Infinity).filter(Boolean));
}

// With many columns, a row becomes a block of labelled values on a phone.
const MANY = 4;

export function table(head, rows, { caption } = {}) {
  for (const row of rows.flat()) {
    let k = 0;
    for (const cell of row.children) {
      const columns = cell.colSpan || 1;
      if (columns === 1) cell.dataset.label = head[k]?.text ?? head[k] ?? "";
      k += columns;
    }
  }
  return h("div", { class: `scroll${head.length > MANY ? " many" : ""}`, tabindex: "0", role: "region", "aria-label": caption ?? "Table" },
    h("table", {}, h("thead", {}, h("tr", {}, head.map((one) => (one === "" ? h("td", {}) : h("th", { scope: "col", class: one.class, title: one.title }, one.text ?? one))))),
      h("tbody", {}, rows)));
}

export function command(text) {
  const button = h("button", { type: "button", on: { click: async () => {
    await navigator.clipboard.writeText(text);
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  } } }, "Copy");
  return h("div", { class: "command" }, h("code", { tabindex: "0" }, text), navigator.clipboard ? button : null);
}

// Resolves when what was changed is on the screen. Work that can wait for it must not delay it: the server may share the machine.
export const painted = () => new Promise((resolve) => requestAnimationFrame(() => setTimeout(resolve)));

export function toast(text) {
  const one = h("div", { class: "toast" }, text);
  document.getElementById("toasts").append(one);
  setTimeout(() => one.remove(), 6000);
}

// Ask before an action that cannot be undone; resolves to true or false.
export function confirm({ title, text, action, danger = false }) {
  return new Promise((resolve) => {
    let answer = false;
    const dialog = h("dialog", { "aria-labelledby": "dialog-title", on: { close: () => { dialog.remove(); resolve(answer); } } },
      h("div", { class: "stack" }, h("h2", { id: "dialog-title" }, title), h("p", { class: "soft" }, text),
        h("div", { class: "row" },
          h("button", { type: "button", on: { click: () => dialog.close() } }, "Back"),
          h("button", { type: "button", class: danger ? "primary danger" : "primary", on: { click: () => { answer = true; dialog.close(); } } }, action))));
    document.body.append(dialog);
    dialog.showModal();
  });
}

// `signIn` leads to the provider's page, if there is one.
export function askToken(wrong, signIn) {
  return new Promise((resolve) => {
    let token = null;
    const field = h("input", { type: "password", id: "token", autocomplete: "off", required: true });
    const use = () => { if (field.value.trim()) { token = field.value.trim(); dialog.close(); } };
    const dialog = h("dialog", { "aria-labelledby": "dialog-title", on: { close: () => { dialog.remove(); resolve(token); } } },
      h("div", { class: "stack" }, h("h2", { id: "dialog-title" }, "This server needs a token"),
        h("p", { class: "soft small" }, wrong ? "That token was not accepted. " : "", signIn ? "Sign in with your account, or use a token. " : "", "A token was issued to you, or is the value of VALERIE_API_TOKEN on the server. This tab keeps it until you close the tab."),
        h("label", { for: "token" }, "Token"), field,
        h("div", { class: "row" }, signIn ? h("button", { type: "button", class: "primary", on: { click: signIn } }, "Sign in") : null, h("button", { type: "button", class: signIn ? null : "primary", on: { click: use } }, "Use token"))));
    field.addEventListener("keydown", (event) => { if (event.key === "Enter") use(); });
    document.body.append(dialog);
    dialog.showModal();
  });
}
