// A grid of thumbnails; `show` resolves when all are there. Each picture from the server is a sheet of many.
import { picture } from "./api.js";
import { h, painted } from "./dom.js";

const SHEET = 16, ACROSS = 8, WIDTH = 160;

export const tileOf = (row) => `${row.frame_id}:${row.instance_id ?? 0}:${row.function}:${row.sensor}`;

export function thumbnails() {
  const element = h("div", { class: "thumbnails" });
  let latest = 0;
  const show = async (rows, { kind, crop, further = false, caption }) => {
    const mine = further ? latest : (latest += 1);
    const cells = rows.map((row) => {
      const [strong, soft] = caption(row);
      const image = h("span", { class: `thumbnail waiting ${crop ? "square" : ""}` });
      return { row, image, link: h("a", { href: `#/frames/${row.frame_id}?view=errors${crop ? "&near=1" : ""}`, title: `variant ${row.variant_index}, ${row.camera}, ${row.function}` }, image, h("span", { class: "small number" }, h("strong", {}, strong), " ", h("span", { class: "soft" }, soft))) };
    });
    if (further) element.append(...cells.map((one) => one.link));
    else element.replaceChildren(...(cells.length ? cells.map((one) => one.link) : [h("p", { class: "soft" }, "No row is selected.")]));
    await painted();
    if (mine !== latest) return;
    await Promise.all(Array.from({ length: Math.ceil(cells.length / SHEET) }, (_, k) => sheet(cells.slice(k * SHEET, (k + 1) * SHEET), kind, crop, () => mine === latest)));
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
