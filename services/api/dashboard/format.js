// Text of numbers, times and states.

const whole = new Intl.NumberFormat("en", { maximumFractionDigits: 0 });
export const NONE = "–";

export const count = (value) => (value === null || value === undefined ? NONE : whole.format(value));
export const fixed = (value, digits = 1) => (value === null || value === undefined ? NONE : value.toFixed(digits));
export const percent = (rate, digits = 1) => (rate === null || rate === undefined ? NONE : `${(100 * rate).toFixed(digits)}\u00a0%`);
// Distance, but mIoU: a first word that has capitals of its own stays.
export const heading = (title) => (/^[a-z]+(?![A-Za-z])/.test(title) ? title[0].toUpperCase() + title.slice(1) : title);

// A number and its unit, which stay on one line.
export const withUnit = (number, unit) => (unit && unit !== "°" ? `${number}\u00a0${unit}` : `${number}${unit ?? ""}`);

// A value of a measure with its unit; /v1/measures says how.
export function shown({ scale, digits, unit }, value) {
  if (value === null || value === undefined) return NONE;
  if (typeof value === "string") return value;
  return withUnit((value * scale).toLocaleString("en", { minimumFractionDigits: digits, maximumFractionDigits: digits }).replace("-", "−"), unit);
}
export const plural = (n, one, many = `${one}s`) => `${count(n)} ${n === 1 ? one : many}`;

export function duration(seconds) {
  if (seconds === null || seconds === undefined) return NONE;
  if (seconds < 60) return `${seconds < 10 && seconds % 1 ? seconds.toFixed(1) : Math.round(seconds)} s`;
  const minutes = Math.floor(seconds / 60);
  if (minutes < 60) return `${minutes} min ${String(Math.round(seconds % 60)).padStart(2, "0")} s`;
  if (minutes < 60 * 48) return `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`;
  return `${Math.round(minutes / 1440)} days`;
}

export const rate = (perSecond) => (perSecond >= 100 ? `${count(perSecond)}/s` : perSecond >= 1 ? `${perSecond.toFixed(1)}/s` : `${(perSecond * 60).toFixed(1)}/min`);

export function bytes(size) {
  const units = ["B", "kB", "MB", "GB", "TB"];
  const power = Math.min(units.length - 1, size < 1 ? 0 : Math.floor(Math.log10(size) / 3));
  return `${Number((size / 1000 ** power).toPrecision(2)).toLocaleString("en")} ${units[power]}`;
}

export function ago(moment) {
  const seconds = (Date.now() - new Date(moment)) / 1000;
  if (seconds < 45) return "just now";
  if (seconds < 5400) return `${Math.max(1, Math.round(seconds / 60))} min ago`;
  if (seconds < 129_600) return `${Math.round(seconds / 3600)} h ago`;
  return clock(moment).slice(0, 10);
}

// As in reports and on the command line: 2026-11-21 14:05 UTC.
export const clock = (moment) => `${new Date(moment).toISOString().slice(0, 16).replace("T", " ")} UTC`;

export const ACTIVE = new Set(["submitted", "running", "paused", "finishing"]);
const LOOKS = {
  submitted: "wait", running: "active", paused: "wait", finishing: "active",
  completed: "good", "completed-with-failures": "bad", cancelled: "ended", failed: "bad",
};
export const look = (state) => LOOKS[state] ?? "";
export const words = (state) => state.replaceAll("-", " ");

// Path of a parameter without the common root.
export const short = (path) => path.replace(/^scene\./, "");
export function value(one) {
  return typeof one === "number" ? String(Number(one.toFixed(4))).replace("-", "−") : String(one);
}
