// What the caller may do: the role of its token, which the server tells. Views offer nothing that it would refuse.
import { get, token } from "./api.js";

const LOOPBACK = new Set(["localhost", "127.0.0.1", "[::1]"]);
let known = { token: undefined, role: "", scopes: [], refused: new Set(), folder: "" };

// Ask for the role unless it is known for the present token.
export async function learnRole() {
  if (known.token === token()) return;
  const { role, scopes, refused, data_dir: folder } = await get("/v1/access");
  known = { token: token(), role, scopes, refused: new Set(refused), folder };
}

export const role = () => known.role;
export const scopes = () => known.scopes;
// `endpoint` as the server names it: "POST /v1/runs".
export const may = (endpoint) => !known.refused.has(endpoint);

// Text as one word of a POSIX shell.
export const quoted = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", String.raw`'\''`)}'`);
export const isRemote = () => !LOOPBACK.has(location.hostname);
// A command that finds the data of this server: on its machine in the folder, from elsewhere at the address if it takes one.
export const reaching = (text, { url = false } = {}) => (known.folder ? `${text} --data-dir ${quoted(known.folder)}` : url && isRemote() ? `${text} --url ${location.origin}` : text);
