// The selection of the page Explore: an expression and brushes over columns, kept in the address.

const UNDEFINED = "undefined";

// { column: { low, high, closed } | { names: [...] } | { undefined: true } }, in the order in which they were drawn.
export class Brushes {
  constructor(texts = []) {
    this.of = new Map();
    for (const text of texts) {
      const [column, kind, rest = ""] = split(text);
      if (kind === UNDEFINED) this.of.set(column, { undefined: true });
      else if (kind === "names") this.of.set(column, { names: rest.split("|") });
      else if (kind === "range") {
        const [low, high, closed] = rest.split("|");
        if (Number.isFinite(Number(low)) && Number.isFinite(Number(high))) this.of.set(column, { low: Number(low), high: Number(high), closed: closed === "1" });
      }
    }
  }

  set(column, brush) {
    if (brush) this.of.set(column, brush);
    else this.of.delete(column);
  }

  texts() {
    return [...this.of].map(([column, brush]) => {
      if (brush.undefined) return `${column}~${UNDEFINED}`;
      if (brush.names) return `${column}~names~${brush.names.join("|")}`;
      return `${column}~range~${brush.low}|${brush.high}|${brush.closed ? 1 : 0}`;
    });
  }

  // The expression that the server reads; see docs/explore.md.
  expression(column) {
    const brush = this.of.get(column);
    if (brush.undefined) return `${column} is undefined`;
    if (brush.names) return `(${brush.names.map((name) => `${column} == ${literal(name)}`).join(" or ")})`;
    return `${column} >= ${brush.low} and ${column} ${brush.closed ? "<=" : "<"} ${brush.high}`;
  }

  where(text) {
    return [text.trim() ? (this.of.size ? `(${text.trim()})` : text.trim()) : "", ...[...this.of.keys()].map((column) => this.expression(column))].filter(Boolean).join(" and ");
  }
}

function split(text) {
  const first = text.indexOf("~");
  const second = text.indexOf("~", first + 1);
  return second < 0 ? [text.slice(0, first), text.slice(first + 1)] : [text.slice(0, first), text.slice(first + 1, second), text.slice(second + 1)];
}

const literal = (value) => (typeof value !== "string" ? String(value) : value === "true" || value === "false" ? value : value.includes("'") ? `"${value}"` : `'${value}'`);

// A bin range of a histogram as a brush. The last bin holds its upper end.
export function brushOfBins({ levels, edges }, numeric, first, last) {
  const count = levels.length || edges.length - 1;
  if (first >= count) return { undefined: true };
  const low = Math.max(0, first), high = Math.min(last, count - 1);
  if (!levels.length) return { low: edges[low], high: edges[high + 1], closed: high === count - 1 };
  if (numeric) return { low: levels[low], high: levels[high], closed: true };
  return { names: levels.slice(low, high + 1) };
}

// The bins that a brush covers, [first, last], or null.
export function binsOfBrush({ levels, edges }, brush) {
  if (!brush) return null;
  const count = levels.length || edges.length - 1;
  if (brush.undefined) return [count, count];
  const inside = Array.from({ length: count }, (_, k) => k).filter((k) => {
    if (brush.names) return brush.names.includes(String(levels[k]));
    if (levels.length) return levels[k] >= brush.low && (brush.closed ? levels[k] <= brush.high : levels[k] < brush.high);
    return edges[k + 1] > brush.low && edges[k] < brush.high;
  });
  return inside.length ? [inside[0], inside[inside.length - 1]] : null;
}
