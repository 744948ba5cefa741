// Requests to /v1: the token, problem documents as errors, pictures as blobs.
import { askToken } from "./dom.js";
import { leave, offered } from "./signin.js";

const KEY = "valerie-token";
let asking = null;

export const token = () => sessionStorage.getItem(KEY);
export const hasToken = () => token() !== null;
export const keepToken = (given) => sessionStorage.setItem(KEY, given);
export const forgetToken = () => sessionStorage.removeItem(KEY);

export class Problem extends Error {
  constructor(status, title, detail, errors = [], again = null) {
    super(detail || title);
    this.status = status;
    this.title = title;
    this.errors = errors;
    this.again = again; // seconds until the server may answer, where it says so
  }
}

async function send(path, options = {}) {
  for (;;) {
    const used = token();
    const headers = { ...options.headers, ...(used ? { Authorization: `Bearer ${used}` } : {}) };
    let response;
    try {
      response = await fetch(path, { ...options, headers });
    } catch (error) {
      if (error.name === "AbortError") throw error;
      throw new Problem(0, "Unreachable", "The server does not answer. Is valerie up still running?");
    }
    if (response.ok) return response;
    if (response.status === 401) {
      // Several requests may be refused at once; ask for the token once.
      asking ??= offered().then((offer) => askToken(used !== null, offer && (() => leave(offer)))).then((given) => { if (given) keepToken(given); return given; }).finally(() => { asking = null; });
      if (await asking) {
        document.getElementById("forget").hidden = false;
        continue;
      }
    }
    let title = response.statusText, detail = "", errors;
    try {
      ({ title, detail, errors } = await response.json());
    } catch { /* no problem document */ }
    throw new Problem(response.status, title, detail, errors, Number(response.headers.get("Retry-After")) || null);
  }
}

export const get = async (path, options) => (await send(path, options)).json();
export const getBytes = async (path, options) => (await send(path, options)).arrayBuffer();
export async function post(path, document, { signal } = {}) {
  const body = document === undefined ? {} : { body: JSON.stringify(document), headers: { "Content-Type": "application/json" } };
  return (await send(path, { method: "POST", signal, ...body })).json();
}
// A spec as its author wrote it.
export const postSpec = async (path, text, { signal, headers } = {}) => (await send(path, { method: "POST", signal, body: text, headers: { ...headers, "Content-Type": "application/yaml" } })).json();
export const replace = async (path, document) => (await send(path, { method: "PUT", body: JSON.stringify(document), headers: { "Content-Type": "application/json" } })).json();
export async function remove(path) { await send(path, { method: "DELETE" }); }

// Recent pictures, which show at once on the way back and forth.
const pictures = new Map();
const KEPT = 96;

export function picture(path) {
  if (!pictures.has(path)) {
    const one = send(path).then((response) => response.blob()).then((blob) => URL.createObjectURL(blob));
    one.catch(() => pictures.delete(path));
    pictures.set(path, one);
    if (pictures.size > KEPT) {
      const [oldest, address] = pictures.entries().next().value;
      pictures.delete(oldest);
      address.then((url) => setTimeout(() => URL.revokeObjectURL(url), 10_000), () => {});
    }
  }
  return pictures.get(path);
}

// A link cannot carry a token, so with a token the file is fetched here and saved.
export async function download(path, name) {
  const blob = await (await send(path)).blob();
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
