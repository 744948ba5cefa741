// What may stand at a place of a spec: from its JSON Schema and from the names that this server knows.

// Where the caret is: the keys around it, what is typed of the word, and whether a key or a value is expected.
export function placeAt(text, position) {
  const before = text.slice(0, position).split("\n");
  const line = before.pop();
  const own = /^(\s*)(?:- )?/.exec(line);
  const path = [];
  let depth = own[1].length + (line.trimStart().startsWith("- ") ? 1 : 0);
  for (let i = before.length - 1; i >= 0 && depth > 0; i -= 1) {
    const parent = /^(\s*)(?:- )?([^\s#:][^:]*):/.exec(before[i]);
    if (parent && parent[1].length < depth) {
      path.unshift(parent[2].trim());
      depth = parent[1].length;
    }
  }
  // Within the line: keys and the brackets of the flow style.
  let rest = line.slice(own[0].length);
  const levels = [{ kind: "{", key: null }];
  let word = "";
  for (const one of rest) {
    const level = levels[levels.length - 1];
    if (one === "{" || one === "[") { levels.push({ kind: one, key: null }); word = ""; }
    else if ((one === "}" || one === "]") && levels.length > 1) { levels.pop(); word = ""; }
    else if (one === ",") { level.key = level.kind === "{" && levels.length > 1 ? null : level.key; word = ""; }
    else if (one === ":" && level.kind === "{" && level.key === null) { level.key = word.trim(); word = ""; }
    else if (one === "#") return null;
    else word += one;
  }
  const keys = levels.map((level) => level.key).filter((key) => key !== null);
  const last = levels[levels.length - 1];
  const item = line.trimStart().startsWith("- ") && levels.length === 1 && last.key === null;
  return { path: [...path, ...keys], word: word.trimStart(), key: last.kind === "{" && last.key === null && !item };
}

// Proposals of a place: [{ text, insert, note }].
export function proposals(place, { schema, names }) {
  if (!place) return [];
  const { path, key } = place;
  const own = named(path, key, names) ?? (key ? keysOf(nodesAt(schema, path), schema) : valuesOf(nodesAt(schema, path), schema));
  const typed = place.word.toLowerCase();
  const fits = own.filter((one) => one.text.toLowerCase().includes(typed) && one.insert !== place.word);
  return fits.sort((a, b) => Number(b.text.toLowerCase().startsWith(typed)) - Number(a.text.toLowerCase().startsWith(typed))).slice(0, 40);
}

const plain = (list, note) => list.map((text) => ({ text, insert: text, note }));

function named(path, key, names) {
  const [head, name] = path;
  if (!key && head === "asset" && path.length === 1) return plain(names.assets, "asset");
  if (!key && head === "functions") return plain(names.functions, "function under test");
  if (!key && head === "cameras") return plain(names.cameras, "camera");
  if (!key && head === "renderer" && path.length === 1) return plain(names.engines, "render engine");
  const inner = path.slice(path.lastIndexOf("vary") + 1);
  const varies = path.includes("vary");
  if (!varies && head !== "constants") return null;
  if (key && (head === "constants" ? path.length === 1 : inner.length === 0)) {
    return names.parameters.map((one) => ({ text: one.name, insert: `${one.name}: `, note: limits(one) }));
  }
  const parameter = names.parameters.find((one) => one.name === (varies ? inner[0] : name));
  if (!parameter) return null;
  const choices = parameter.type === "BOOL" ? ["true", "false"] : parameter.choices;
  if (!varies) return key ? null : plain(choices.length ? choices : [String(parameter.default)], limits(parameter));
  if (inner.length === 1 && !key) return distributions(parameter);
  if (inner.length === 2 && inner[1] === "choice") return plain(choices, limits(parameter));
  return null;
}

export const limits = ({ type, minimum, maximum, choices, unit }) => (type === "BOOL" ? "true or false" : choices.length ? choices.join(", ")
  : `${minimum ?? "−∞"} … ${maximum ?? "∞"}${unit ? ` ${unit}` : ""}`);

function distributions(parameter) {
  const { first, last, step } = reach(parameter);
  if (parameter.choices.length || parameter.type === "BOOL") {
    const all = (parameter.type === "BOOL" ? ["true", "false"] : parameter.choices).join(", ");
    return [{ text: "choice", insert: `{choice: [${all}]}`, note: "listed values" }];
  }
  return [
    { text: "homogeneous", insert: `{homogeneous: {from: ${first}, to: ${last}, step: ${step}}}`, note: "steps from … to" },
    { text: "uniform", insert: `{uniform: {from: ${first}, to: ${last}, count: 5}}`, note: "evenly over a range" },
    { text: "gaussian", insert: `{gaussian: {mean: ${parameter.default}, sigma: ${step}, count: 5}}`, note: "normal, truncated to the range" },
    { text: "choice", insert: `{choice: [${first}, ${last}]}`, note: "listed values" },
  ];
}

// A range to begin with: around the default, within the declared one, in four or more round steps.
export function reach({ minimum, maximum, default: usual, type }) {
  const first = minimum ?? Math.min(0, usual), last = maximum ?? Math.max(usual * 2, first + 10);
  const raw = (last - first) / 4;
  const power = 10 ** Math.floor(Math.log10(raw || 1));
  const round = [5, 2, 1].map((n) => n * power).find((n) => n <= raw) ?? raw;
  return { first, last, step: type === "INT" ? Math.max(1, Math.round(round)) : Number(round.toPrecision(3)) };
}

// The schemas that may describe a place.
function nodesAt(schema, path) {
  let nodes = branches(schema, schema);
  for (const key of path) {
    nodes = nodes.flatMap((node) => [
      ...(node.properties?.[key] ? branches(node.properties[key], schema) : []),
      ...(typeof node.additionalProperties === "object" && !node.properties?.[key] ? branches(node.additionalProperties, schema) : []),
      ...(typeof node.items === "object" ? branches(node.items, schema).filter((one) => one.properties?.[key]).flatMap((one) => branches(one.properties[key], schema)) : []),
    ]);
  }
  return nodes.flatMap((node) => (typeof node.items === "object" ? [node, ...branches(node.items, schema)] : [node]));
}

function branches(node, schema) {
  if (node.$ref) return branches(schema.$defs[node.$ref.split("/").pop()], schema);
  const inner = [...(node.anyOf ?? []), ...(node.oneOf ?? [])];
  return [node, ...inner.flatMap((one) => branches(one, schema))];
}

function keysOf(nodes) {
  const known = new Map();
  for (const node of nodes) for (const [key, one] of Object.entries(node.properties ?? {})) if (!known.has(key)) known.set(key, one.description ?? "");
  return [...known].map(([key, note]) => ({ text: key, insert: `${key}: `, note }));
}

function valuesOf(nodes) {
  const values = nodes.flatMap((node) => [...(node.enum ?? []), ...(node.const === undefined ? [] : [node.const]), ...(node.examples ?? []), ...(node.type === "boolean" ? [true, false] : [])]);
  return [...new Set(values.filter((one) => typeof one !== "object").map(String))].map((text) => ({ text, insert: text, note: "" }));
}
