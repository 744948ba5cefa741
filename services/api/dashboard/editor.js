// A text area for specs, with the numbers of its lines, marked problems and completion.
import { placeAt, proposals } from "./completion.js";
import { h } from "./dom.js";

export function editor({ changed, known, label }) {
  const area = h("textarea", { id: "spec", spellcheck: "false", autocapitalize: "off", autocomplete: "off", wrap: "off", "aria-label": label, "aria-autocomplete": "list", "aria-controls": "proposals", "aria-describedby": "problems" });
  const numbers = h("pre", { class: "numbers", "aria-hidden": "true" });
  const list = h("ul", { id: "proposals", class: "proposals", role: "listbox", "aria-label": "Completions", hidden: true });
  const element = h("div", { class: "editor" }, numbers, area, list);
  let marked = new Map();
  let offered = [];
  let chosen = 0;
  let place = null;

  const number = () => {
    const count = area.value.split("\n").length;
    numbers.replaceChildren(...Array.from({ length: count }, (_, i) => h("span", { class: marked.has(i + 1) ? "bad" : null, title: marked.get(i + 1) }, `${i + 1}\n`)));
    numbers.scrollTop = area.scrollTop;
  };
  const close = () => { list.hidden = true; offered = []; area.removeAttribute("aria-activedescendant"); };
  const choose = (index) => {
    chosen = (index + offered.length) % offered.length;
    [...list.children].forEach((one, i) => one.setAttribute("aria-selected", String(i === chosen)));
    list.children[chosen].scrollIntoView({ block: "nearest" });
    area.setAttribute("aria-activedescendant", `proposal-${chosen}`);
  };
  // As typed, so that undo takes it back.
  const write = (from, to, text) => {
    area.setSelectionRange(from, to);
    document.execCommand("insertText", false, text);
  };
  const take = () => {
    const { insert } = offered[chosen];
    const end = area.selectionStart;
    const space = area.value[end - place.word.length - 1] === ":" ? " " : "";
    close();
    write(end - place.word.length, end, space + insert);
    offer(false);
  };
  const offer = (asked) => {
    place = placeAt(area.value, area.selectionStart);
    offered = area.selectionStart === area.selectionEnd ? proposals(place, known()) : [];
    if (!offered.length || (!asked && !place.word)) return close();
    list.replaceChildren(...offered.map((one, i) => h("li", { id: `proposal-${i}`, role: "option", "aria-selected": "false", on: { mousedown: (event) => { event.preventDefault(); chosen = i; take(); } } },
      h("strong", {}, one.text), " ", h("span", { class: "soft" }, one.note))));
    list.hidden = false;
    const style = getComputedStyle(area);
    const lines = area.value.slice(0, area.selectionStart).split("\n");
    const width = parseFloat(style.fontSize) * 0.602; // of a character of this monospaced type
    list.style.setProperty("top", `${Math.min(area.clientHeight - 20, lines.length * parseFloat(style.lineHeight) + parseFloat(style.paddingTop) - area.scrollTop + 4)}px`);
    list.style.setProperty("left", `${Math.max(2, Math.min(element.clientWidth - list.offsetWidth - 4, numbers.offsetWidth + Math.max(0, (lines.pop().length - place.word.length) * width - area.scrollLeft)))}px`);
    choose(0);
  };

  area.addEventListener("input", () => { number(); changed(area.value); offer(false); });
  area.addEventListener("scroll", () => { numbers.scrollTop = area.scrollTop; close(); });
  area.addEventListener("blur", close);
  area.addEventListener("click", close);
  area.addEventListener("keydown", (event) => {
    if (event.key === " " && event.ctrlKey) { event.preventDefault(); offer(true); return; }
    if (!list.hidden) {
      if (event.key === "ArrowDown" || event.key === "ArrowUp") { event.preventDefault(); choose(chosen + (event.key === "ArrowDown" ? 1 : -1)); return; }
      if (event.key === "Enter" || event.key === "Tab") { event.preventDefault(); take(); return; }
      if (event.key === "Escape") { event.preventDefault(); close(); return; }
    }
    if (event.key === "Enter" && !event.shiftKey) {
      const line = area.value.slice(0, area.selectionStart).split("\n").pop();
      event.preventDefault();
      write(area.selectionStart, area.selectionEnd, `\n${/^\s*/.exec(line)[0]}${/:\s*$/.test(line) ? "  " : ""}`);
    }
  });
  return {
    element,
    get text() { return area.value; },
    // Another text, with the caret where it was.
    set text(text) {
      if (text === area.value) return;
      const at = area.selectionStart;
      area.value = text;
      area.setSelectionRange(at, at);
      number();
    },
    mark(problems) {
      marked = problems;
      number();
      if (problems.size) area.setAttribute("aria-invalid", "true");
      else area.removeAttribute("aria-invalid");
    },
    goTo(line) {
      const start = area.value.split("\n").slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
      area.focus();
      area.setSelectionRange(start, start + (area.value.split("\n")[line - 1] ?? "").length);
      area.scrollTop = (line - 4) * parseFloat(getComputedStyle(area).lineHeight);
    },
  };
}
