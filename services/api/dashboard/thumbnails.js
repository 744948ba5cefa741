// A grid of thumbnails; `show` resolves when all are there. Each picture from the server is a sheet of many.
import { picture } from "./api.js";
import { h, painted } from "./dom.js";

const SHEET = 16, ACROSS = 8, WIDTH = 160;

// The colours of the pictures "errors".
export const errorLegend = () => h("div", { class: "legend under" }, [["hit", "person, found"], ["miss", "person, missed"], ["false", "called person, but none"]].map(([kind, text]) =>
  h("span", { class: "key" }, h("span", { class: `patch ${kind}` }), text)));

export const tileOf = (row) => `${row.frame_id}:${row.instance_id ?? 0}:${row.function}:${row.sensor}`;

export function thumbnails() {
  const none = h("p", { class: "soft", hidden: true }, "No row is selected.");
  const element = h("div", { class: "thumbnails" }, none);
  const cells = []; // shown ones; they are filled anew, since building and laying them out takes longer
  let latest = 0;
  const added = () => {
    const image = h("span", {}), strong = h("strong", {}), soft = h("span", { class: "soft" });
    const link = h("a", {}, image, h("span", { class: "small number" }, strong, " ", soft));
    element.append(link);
    return { image, strong, soft, link };
  };
  const show = async (rows, { kind, crop, further = false, caption }) => {
    const mine = further ? latest : (latest += 1), first = further ? cells.length : 0;
    const filled = rows.map((row, k) => {
      const one = (cells[first + k] ??= added());
      one.row = row;
      [one.strong.textContent, one.soft.textContent] = caption(row);
      one.link.href = `#/frames/${row.frame_id}?view=errors${crop ? "&near=1" : ""}`;
      one.link.title = `variant ${row.variant_index}, ${row.camera}, ${row.function}`;
      one.image.className = `thumbnail waiting ${crop ? "square" : ""}`;
      one.image.style.removeProperty("background-image");
      return one;
    });
    for (const one of cells.splice(first + rows.length)) one.link.remove();
    none.hidden = cells.length > 0;
    await painted();
    if (mine !== latest) return;
    await Promise.all(Array.from({ length: Math.ceil(filled.length / SHEET) }, (_, k) => sheet(filled.slice(k * SHEET, (k + 1) * SHEET), kind, crop, () => mine === latest)));
  };
  return { element, show };
}

// Fill images with the thumbnails of rows: [{ row, image }].
export async function sheet(cells, kind, crop, wanted = () => true) {
  const parts = new URLSearchParams([["kind", kind], ["crop", crop ? "1" : "0"], ["width", String(WIDTH)], ...cells.map(({ row }) => ["tile", tileOf(row)])]);
  try {
    const url = await picture(`/v1/explore/sheet?${parts}`);
    if (!wanted()) return;
    const across = Math.min(cells.length, ACROSS), down = Math.ceil(cells.length / ACROSS);
    cells.forEach(({ image }, k) => {
      const [x, y] = [k % ACROSS, Math.floor(k / ACROSS)];
      image.style.setProperty("background-image", `url(${url})`);
      image.style.setProperty("background-size", `${100 * across}% ${100 * down}%`);
      image.style.setProperty("background-position", `${across > 1 ? (100 * x) / (across - 1) : 0}% ${down > 1 ? (100 * y) / (down - 1) : 0}%`);
      image.classList.remove("waiting");
    });
  } catch (error) {
    if (error.name !== "AbortError") for (const { image } of cells) image.classList.remove("waiting");
  }
}
